"""A battery's results compare between machines within the tolerance of docs/assess.md: what it shows is what it showed
where it was frozen. ``assess-1.png`` holds that, shrunk; as a battery never changes, nor does the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.contract import Dataset
from rauca_core.detect import load_detector
from rauca_core.runtime.images import read_image
from rauca_core.study import recipes
from rauca_core.study.battery import load_battery
from rauca_core.study.engine import Engine
from rauca_core.study.store import Store

SHRUNK = 8  # pixels a side become one: noise of single pixels is no machine's mark
SEEN = Path(__file__).with_name("assess-1.png")
SCORES = {"own paint": 0.988, "camouflage": 0.412}  # of our own detector


def shrink(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Means of blocks, (H / 8, W / 8, 3)."""
    height, width, channels = picture.shape
    return picture.reshape(height // SHRUNK, SHRUNK, width // SHRUNK, SHRUNK, channels).mean((1, 3))


def render_anew(folder: Path) -> dict[str, NDArray[np.uint8]]:
    """A view of the battery, by Blender: the vehicle in its own paint and in a camouflage."""
    battery = load_battery("assess-1")
    (vehicle, choice), *_ = battery.choices()
    views = battery.views_of(choice, "quick")["street-unseen"]
    some = {**views.options, "frames": views.options["frames"][:2]}
    few = recipes.Artifact(views.kind, views.label, views.settings, views.inputs, some)
    worn = recipes.camouflage_in(battery.camouflages_of(vehicle)["ours-ssd"], "ours-ssd")
    engine = Engine(Store(folder))
    (made,) = engine.make(few)
    frame = Dataset(made).frames()[0].id  # of those that show the vehicle
    (rendered,) = engine.make(recipes.renders(few, worn, [frame]))
    return {
        "own paint": read_image(made / "frames" / frame / "image.png"),
        "camouflage": read_image(rendered / f"{frame}.png"),
    }


@pytest.mark.stored
def test_a_view_is_what_it_was_where_the_battery_was_frozen(tmp_path):
    detector, kept = load_detector("frcnn-synth"), np.split(read_image(SEEN).astype(float), len(SCORES))
    for (paint, picture), then in zip(render_anew(tmp_path).items(), kept, strict=True):
        assert np.abs(shrink(picture) - then).mean() < 0.5, paint
        (found,) = detector.detect(torch.from_numpy(picture.copy()).permute(2, 0, 1)[None] / 255)
        assert float(found.scores.max()) == pytest.approx(SCORES[paint], abs=0.05), paint
