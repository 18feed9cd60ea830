from __future__ import annotations

import numpy as np
import pytest

from rauca_core.contract import RaucaError, load_passes
from rauca_core.environment import load_exact


def test_maps_come_back_as_float32(dataset):
    frame = dataset.frames()[0].id
    light = load_exact(dataset, frame)
    written = load_passes(dataset.frame_folder(frame), ("A", "B"))
    assert light.A.dtype == light.B.dtype == np.float32
    assert np.allclose(light.A, written["A"], atol=1e-3)
    assert np.allclose(light.B, written["B"], atol=1e-3)


def test_data_set_without_light_says_so(dataset_factory, tmp_path, box_vehicle):
    dark = dataset_factory(tmp_path / "dark", box_vehicle, light=False)
    with pytest.raises(RaucaError, match="without light maps"):
        load_exact(dark, dark.frames()[0].id)


@pytest.mark.parametrize(
    ("maps", "said"),
    [
        (lambda A: {}, r"passes\.npz"),
        (lambda A: {"A": A[:8, :8], "B": A}, r"A has shape \(8, 8, 3\)"),
        (lambda A: {"A": A, "B": A * np.nan}, "B holds NaN"),
    ],
)
def test_missing_misshapen_or_broken_maps_are_named(dataset, maps, said):
    frame = dataset.frames()[0].id
    file = dataset.frame_folder(frame) / "passes.npz"
    A = np.load(file)["A"]
    np.savez(file, **maps(A))
    with pytest.raises(RaucaError, match=said):
        load_exact(dataset, frame)
