"""Detectors' published weights, for tests that need real ones."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rauca_core.contract import RaucaError
from rauca_core.detect import fetch


def published_weights(*names: str) -> dict[str, Path]:
    """The files of detectors by name, fetched through the registry.

    Without them the test is skipped where RAUCA_OFFLINE is 1, and fails elsewhere.
    """
    try:
        return {name: fetch(name) for name in names}
    except RaucaError as error:
        if os.environ.get("RAUCA_OFFLINE") == "1":
            pytest.skip(f"RAUCA_OFFLINE=1 and the weights are not in the cache ({error})")
        raise
