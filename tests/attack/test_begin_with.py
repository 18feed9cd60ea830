"""An optimization that begins with a finished camouflage."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from PIL import Image

from benchmarks.stability.detectors import SmallDetector
from rauca_core.attack import DetectorEnsemble, make_settings, random_camouflage, settings_of
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, RaucaError, Vehicle, load_camouflage
from rauca_core.runtime.images import read_image

SIDE = 32


@pytest.fixture
def given(tmp_path: Path, box_vehicle: Vehicle) -> Path:
    random_camouflage(tmp_path / "given.json", box_vehicle, size=SIDE, seed=3, cell=4)
    return tmp_path / "given.json"


def begun(dataset: Dataset, detector: SmallDetector, **chosen: object) -> Run:
    settings = make_settings(**{"map_size": SIDE, "samples": 2, "batch": 1, **chosen})
    return Run(dataset, DetectorEnsemble([detector], "car"), settings)


def texels_of(run: Run, path: Path) -> torch.Tensor:
    pixels = read_image(load_camouflage(path)[1]).transpose(2, 0, 1)
    return run.store.pyramid.from_map(torch.from_numpy(pixels.copy()).float() / 255)


def test_free_texels_begin_as_they_are_given(dataset: Dataset, small_detector: SmallDetector, given: Path) -> None:
    run = begun(dataset, small_detector, begin_with=given)
    assert torch.equal(run.texture.texels().detach(), texels_of(run, given))
    run.close()


def test_patches_begin_with_the_mean_light_of_their_texels(
    dataset: Dataset, small_detector: SmallDetector, given: Path
) -> None:
    ours = settings_of("ours", begin_with=given, name="ours", map_size=SIDE, samples=2)
    run = begun(dataset, small_detector, **ours)
    found, wanted = run.texture.texels().detach(), texels_of(run, given)
    assert found.shape == wanted.shape
    assert (found - wanted).abs().mean() < (wanted.mean(0) - wanted).abs().mean()
    run.close()


def test_what_it_begins_with_is_part_of_the_identity(given: Path, tmp_path: Path, box_vehicle: Vehicle) -> None:
    random_camouflage(tmp_path / "other.json", box_vehicle, size=SIDE, seed=4, cell=4)
    one, other = (make_settings(begin_with=path).identity() for path in (given, tmp_path / "other.json"))
    assert one["begin_with"] != other["begin_with"]
    assert str(tmp_path) not in str(one)  # where it lies changes nothing
    assert "begin_with" not in make_settings().identity()


@pytest.mark.parametrize("size", [SIDE // 2, 2 * SIDE])
def test_a_map_of_another_size_is_resampled(
    dataset: Dataset, small_detector: SmallDetector, tmp_path: Path, box_vehicle: Vehicle, size: int
) -> None:
    # Cells that are whole texels at either size: what is resampled shows the same colors.
    random_camouflage(tmp_path / "other.json", box_vehicle, size=size, seed=4, cell=size // 4)
    random_camouflage(tmp_path / "same.json", box_vehicle, size=SIDE, seed=4, cell=SIDE // 4)
    run = begun(dataset, small_detector, begin_with=tmp_path / "other.json")
    off = (run.texture.texels().detach() - texels_of(run, tmp_path / "same.json")).abs()
    assert off.median() < 1 / 255
    run.close()


def test_what_does_not_fit_is_refused(dataset: Dataset, small_detector: SmallDetector, given: Path) -> None:
    with pytest.raises(RaucaError, match="is of texels, not facets"):
        begun(dataset, small_detector, begin_with=given, paint="facets")
    Image.new("RGB", (SIDE, 2 * SIDE)).save(given.with_suffix(".png"))
    with pytest.raises(RaucaError, match=r"given\.png: 32x64 pixels; a UV map is a square RGB picture"):
        begun(dataset, small_detector, begin_with=given)
