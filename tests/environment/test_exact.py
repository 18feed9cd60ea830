from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import (
    Camera,
    Dataset,
    Frame,
    FramePasses,
    Plan,
    Quality,
    RaucaError,
    Ring,
    Weather,
    claim_folder,
    save_frame,
)
from rauca_core.environment import load_exact

SIZE = 16
DAY = Weather("day", 45.0)
MAPS = np.random.default_rng(0).random((2, SIZE, SIZE, 3)).astype(np.float32)


def plan(light: bool) -> Plan:
    ring = Ring((0.0,), (10.0,), (5.0,))
    return Plan("test", "box", "0" * 16, SIZE, Quality(1), light, (DAY,), ring, 1, (9, 9, 9), 0.5, 0, "none")


def write(folder: Path, A: np.ndarray | None, B: np.ndarray | None, light: bool = True) -> tuple[Dataset, str]:
    claim_folder(folder, plan(light))
    (frame_id, location, view, weather) = plan(light).frames()[0]
    camera = Camera.look_at(np.array([5.0, 0, 1]), np.zeros(3), 60, SIZE, SIZE)
    frame = Frame(frame_id, location, view, camera, np.eye(4), weather, 0, 10, 5, None, 1.0, 0)
    flat = np.zeros((SIZE, SIZE), np.float32)
    save_frame(folder / "frames" / frame_id, frame, FramePasses(MAPS[0], flat, flat, flat, A, B))
    return Dataset(folder), frame_id


def test_maps_come_back_as_float32(tmp_path: Path) -> None:
    light = load_exact(*write(tmp_path, MAPS[0], MAPS[1]))
    assert light.A.dtype == light.B.dtype == np.float32
    assert np.allclose(light.A, MAPS[0], atol=1e-3)
    assert np.allclose(light.B, MAPS[1], atol=1e-3)


def test_data_set_without_light_says_so(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match="without light maps"):
        load_exact(*write(tmp_path, None, None, light=False))


def test_missing_or_misshapen_maps_are_named(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"passes\.npz"):
        load_exact(*write(tmp_path / "missing", None, None))
    with pytest.raises(RaucaError, match=r"A has shape \(8, 8, 3\)"):
        load_exact(*write(tmp_path / "small", MAPS[0, :8, :8], MAPS[1]))
