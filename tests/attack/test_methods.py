"""Each rival method: lowers its own objective, ends as a UV map that looks like what was optimized, and resumes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.stability.detectors import SmallDetector
from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import OptimizerSettings, make_settings, read_history, run_optimization
from rauca_core.attack import losses as objectives
from rauca_core.attack.ensemble import DetectorEnsemble
from rauca_core.attack.frames import FrameStore, render_batch
from rauca_core.attack.methods import METHODS, method_named, settings_of
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, RaucaError, Vehicle, load_camouflage
from rauca_core.render import MipmappedTexture, srgb_to_linear
from rauca_core.runtime.images import read_image

SMALL = {"steps": 6, "batch": 2, "map_size": 64, "samples": 2, "checkpoint_every": 3, "lr": 0.03, "memory_mb": 256}


def settings(method: str, **chosen: Any) -> OptimizerSettings:
    return make_settings(**settings_of(method, **(SMALL | chosen)))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_lowers_its_own_loss(
    dataset: Dataset, small_detector: Any, tmp_path: Path, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(objectives, "CLOSE", 0.02)  # the small detector's boxes are small too
    seen = []
    chosen = settings(method, steps=30, batch=6, roa=False, shift=0.0)
    path = run_optimization(dataset, [small_detector], chosen, tmp_path / "out", on_step=seen.append)
    assert seen[-1].loss < seen[0].loss
    if method != "das":  # its seed picture is a strong pull; what it is worth is measured below
        assert seen[-1].attack < seen[0].attack
    assert seen[0].loss == pytest.approx(
        seen[0].attack + chosen.beta * seen[0].smooth + chosen.gamma * seen[0].prior, rel=1e-5
    )
    camouflage, image = load_camouflage(path)
    assert (camouflage.method, camouflage.name) == (method, method)
    assert read_image(image).std() > 1
    assert read_history(tmp_path / "out")[0]["prior"] == seen[0].prior


def test_attention_falls_when_nothing_else_counts(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    seen = []
    chosen = settings("das", steps=25, batch=6, beta=0.0, gamma=0.0, lr=0.1)
    run_optimization(dataset, [small_detector], chosen, tmp_path / "out", on_step=seen.append)
    assert seen[0].attack > 0
    assert seen[-1].attack < 0.9 * seen[0].attack


@pytest.mark.parametrize("method", ["active", "dta", "fca", "das"])
def test_uv_map_shows_what_was_optimized(
    box_vehicle: Vehicle, small_detector: Any, tmp_path: Path, method: str
) -> None:
    """Views of the layout and of the UV map that it ends as, in the same light, differ by texel filtering only."""
    data = make_dataset(tmp_path / "fine", box_vehicle, 128, (40.0, 250.0))
    fine = {"map_size": 512, "samples": 4, "pixel_filter": "blackman-harris", "light": "exact", "texture_size": 4}
    chosen = settings(method, tile_m=1.6, pattern_side=16, start="seed" if method == "das" else "random", **fine)
    run = Run(data, DetectorEnsemble([small_detector], "car"), chosen)
    store, on_map = run.store, FrameStore(data, make_settings(map_size=512, samples=4))
    indices = range(len(store))
    with torch.no_grad():
        optimized = render_batch(
            [store.ready(i) for i in indices],
            MipmappedTexture(store.layout.taps.pyramid, srgb_to_linear(run.texture.colors())),
        )
        deployed = render_batch(
            [on_map.ready(i) for i in indices], MipmappedTexture(on_map.pyramid, srgb_to_linear(run.texture.texels()))
        )
    run.close()
    painted = np.stack([on_map.ready(i).taps.coverage() > 0.99 for i in indices])
    difference = (optimized - deployed).abs().amax(1).numpy()[painted]
    spread = deployed.permute(0, 2, 3, 1).numpy()[painted].std()
    assert spread > 0.02
    assert np.mean(difference) < 0.1 * spread
    assert np.quantile(difference, 0.99) < spread


def test_shifted_pattern_reads_neighboring_texels(dataset: Dataset, small_detector: Any) -> None:
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), settings("active", pattern_side=8, shift=0.5))
    at_rest = run.texture.colors().detach().reshape(8, 8, 3)
    moves = set()
    for step in range(12):
        run.step = step
        moved = run._painted().detach().reshape(8, 8, 3)
        (found,) = [(r, c) for r in range(8) for c in range(8) if torch.equal(moved, at_rest.roll((r, c), (0, 1)))]
        moves.add(found)
    run.close()
    assert len(moves) > 6


def test_partial_cover_leaves_the_rest_in_reference_paint(dataset: Dataset, small_detector: Any) -> None:
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), settings("das"))
    with torch.no_grad():
        run.texture.parameter.add_(3.0)
        colors = run.texture.colors().reshape(8, -1, 3)
    run.close()
    grey = torch.full((3,), 140 / 255)
    kept = torch.isclose(colors, grey).all(-1).all(-1)
    assert kept.tolist() == [False, False, True, True] * 2  # the box's long sides are its doors


def test_unknown_methods_and_settings_that_do_not_fit(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"no 'fcb'; choose one of das, fca, dta, active, rauca-base, rauca-final"):
        method_named("fcb")
    with pytest.raises(RaucaError, match="panels are painted on facets"):
        run_optimization(dataset, [small_detector], settings("das", paint="texels"), tmp_path / "a")
    with pytest.raises(RaucaError, match="smooth: pattern needs paint: pattern"):
        run_optimization(dataset, [small_detector], settings("fca", smooth="pattern"), tmp_path / "b")
    with pytest.raises(RaucaError, match="prior: seed needs cover: panels"):
        run_optimization(dataset, [small_detector], settings("fca", prior="seed"), tmp_path / "c")
    with pytest.raises(RaucaError, match="attention cannot be read"):
        run_optimization(dataset, [SmallDetector()], settings("das"), tmp_path / "d")
    assert settings("fca", lr=0.5, name="mine").name == "mine"
