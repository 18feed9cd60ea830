from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rauca_core.attack import random_camouflage
from rauca_core.contract import RaucaError, Vehicle, load_camouflage
from rauca_core.render.mipmap import texel_coverage
from rauca_core.runtime.images import read_image


def test_random_paint_is_uniform_per_cell(box_vehicle: Vehicle, tmp_path: Path) -> None:
    random_camouflage(tmp_path / "a.json", box_vehicle, size=256, seed=1, cell=4)
    camouflage, image = load_camouflage(tmp_path / "a.json")
    pixels = read_image(image)
    inside = (texel_coverage(box_vehicle, 256) > 0).reshape(64, 4, 64, 4).all((1, 3))
    cells = pixels.reshape(64, 4, 64, 4, 3).transpose(0, 2, 1, 3, 4)[inside]
    assert (cells == cells[:, :1, :1]).all()
    assert np.allclose(cells[:, 0, 0].mean(0), 127.5, atol=8)
    assert cells.min() < 3
    assert cells.max() > 252
    camouflage.check_fits(box_vehicle.atlas_id, "test")
    assert camouflage.made["cell_texels"] == 4
    random_camouflage(tmp_path / "b.json", box_vehicle, size=256, seed=1, cell=4)
    random_camouflage(tmp_path / "c.json", box_vehicle, size=256, seed=2, cell=4)
    assert (tmp_path / "b.png").read_bytes() == (tmp_path / "a.png").read_bytes()
    assert (tmp_path / "c.png").read_bytes() != (tmp_path / "a.png").read_bytes()
    with pytest.raises(RaucaError, match="cell"):
        random_camouflage(tmp_path / "d.json", box_vehicle, size=256, cell=0)
