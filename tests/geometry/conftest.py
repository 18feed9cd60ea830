"""The sedan, built once for all tests of the room."""

from __future__ import annotations

import pytest

from rauca_core.contract import Vehicle
from rauca_core.geometry import build_car


@pytest.fixture(scope="session")
def sedan() -> Vehicle:
    return build_car("sedan")
