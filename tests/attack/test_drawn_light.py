"""``--views dense --light irradiance``: the paint's light through the optimizer's own taps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import make_settings, run_optimization
from rauca_core.attack.drawn_frames import DrawnStore
from rauca_core.contract import Dataset, RaucaError
from rauca_core.environment.place_light import light_places
from rauca_core.environment.views import Views


def settings(**chosen: Any) -> Any:
    small = {"steps": 2, "batch": 2, "map_size": 512, "samples": 3, "views": "dense", "light": "irradiance"}
    return make_settings(**(small | chosen))


def test_light_that_is_missing_or_estimated_is_refused(dataset: Dataset) -> None:
    with pytest.raises(RaucaError, match="not fitted yet; run `rauca dataset light"):
        DrawnStore(dataset, settings())
    with pytest.raises(RaucaError, match="ours is of rendered frames"):
        DrawnStore(dataset, settings(light="ours"))


@pytest.mark.parametrize("paint", ["texels", "facets"])
def test_the_light_of_a_view_is_that_of_its_texture_through_any_taps(dataset: Dataset, paint: str) -> None:
    list(light_places(dataset.folder))
    store = DrawnStore(dataset, settings(paint=paint))
    ready, alone = store.ready(3), Views(dataset, len(store), seed=store.views.seed)[3]
    assert ready.frame.id == alone.frame.id
    assert alone.passes.A is not None
    own, theirs = ready.A.numpy(), alone.passes.A.reshape(-1, 3)[ready.taps.pixels]
    assert np.isfinite(own).all()
    solid = alone.passes.paint.reshape(-1)[ready.taps.pixels] > 0.99
    assert solid.sum() > 50
    assert np.median(np.abs(own - theirs)[solid] / theirs[solid]) < 0.02
    exact = DrawnStore(dataset, settings(paint=paint, light="exact")).ready(3)
    assert torch.equal(ready.A, exact.A)  # textures are used wherever there are any


def test_the_command_runs_in_both(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    list(light_places(dataset.folder))
    assert run_optimization(dataset, [small_detector], settings(), tmp_path / "out").is_file()
