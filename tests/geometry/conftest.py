"""Vehicles, each built once for all tests of the room."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from rauca_core.contract import Vehicle
from rauca_core.geometry.build import BUILDERS


@pytest.fixture(scope="session")
def build() -> Callable[[str], Vehicle]:
    return cache(lambda name: BUILDERS[name]())
