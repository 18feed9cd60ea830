from __future__ import annotations

import os
from pathlib import Path

import pytest

from rauca_core.contract import RaucaError
from rauca_core.detect import fetch

TINY = ("yolov2-tiny", "yolov3-tiny", "yolov4-tiny")


@pytest.fixture(scope="session")
def tiny_weights() -> dict[str, Path]:
    """The three tiny networks' published weights, fetched through the registry once."""
    try:
        return {name: fetch(name) for name in TINY}
    except RaucaError as error:
        if os.environ.get("RAUCA_OFFLINE") == "1":
            pytest.skip(f"RAUCA_OFFLINE=1 and the weights are not in the cache ({error})")
        raise
