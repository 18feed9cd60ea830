"""Optimizing under every constraint: the loss falls, the map keeps to what was asked, a stop changes nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from typer.testing import CliRunner

from pipelines.cli import app
from pipelines.naturalness import make_naturalness
from rauca_core.attack import make_settings, read_history, run_optimization
from rauca_core.attack.ensemble import DetectorEnsemble
from rauca_core.attack.naturalness import Naturalness
from rauca_core.attack.naturalness.colors import distances
from rauca_core.attack.naturalness.palette import palette_bytes
from rauca_core.attack.naturalness.reference import distance_of_map, fingerprint, reference_texels
from rauca_core.attack.naturalness.texture import Constraints
from rauca_core.attack.run import Run
from rauca_core.contract import Camouflage, Dataset, RaucaError, Vehicle, load_camouflage, load_vehicle, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.render import Pyramid
from rauca_core.runtime.images import read_image

SMALL = {"steps": 6, "batch": 2, "map_size": 64, "samples": 2, "checkpoint_every": 3, "lr": 0.03, "memory_mb": 256}
PALETTE = ("#101010", "#4b5320", "#c8c0a0", "#f0f0f0")
CASES = {
    "palette": Naturalness(palette=PALETTE),
    "one color": Naturalness(palette=("#336699",)),
    "patches": Naturalness(feature_cm=50),
    "symmetric": Naturalness(feature_cm=50, symmetric=True),
    "bound": Naturalness(reference="#8c8c8c", max_delta_e=15),
    "black": Naturalness(reference="#000000", max_delta_e=15),
    "no way": Naturalness(reference="#8c6432", max_delta_e=0),
    "all": Naturalness(palette=PALETTE, feature_cm=50, reference="#8c8c8c", max_delta_e=50),
}


def run(dataset: Dataset, detector: Any, out: Path, natural: Naturalness, **more: Any) -> tuple[np.ndarray, Camouflage]:
    path = run_optimization(dataset, [detector], make_settings(**(SMALL | {"natural": natural} | more)), out)
    record, image = load_camouflage(path)
    return read_image(image), record


@pytest.mark.parametrize("case", CASES)
def test_the_finished_map_keeps_to_what_was_asked(
    dataset: Dataset, small_detector: Any, tmp_path: Path, case: str
) -> None:
    natural = CASES[case]
    uv_map, record = run(dataset, small_detector, tmp_path / "out", natural)
    assert {"symmetric": False} | record.made["settings"]["natural"] == natural.model_dump(mode="json")
    history = [[line[k] for k in ("loss", "attack", "smooth")] for line in read_history(tmp_path / "out")]
    assert np.isfinite(history).all()
    vehicle = load_vehicle(dataset.vehicle_folder, read_image)
    texels = uv_map.reshape(-1, 3)[Pyramid.of(vehicle, 64).texels]
    if natural.palette:
        found = {tuple(row) for row in uv_map.reshape(-1, 3).tolist()}
        assert found <= {tuple(row) for row in palette_bytes(natural.palette).tolist()}
    if natural.reference is not None:
        home = np.array([int(natural.reference[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        apart = distances(texels / 255.0, np.broadcast_to(home, texels.shape))
        assert apart.max() <= natural.max_delta_e
        assert record.made["natural"]["largest_delta_e"] == pytest.approx(apart.max(), abs=0.02)
        assert distance_of_map(vehicle, uv_map, natural).mean == pytest.approx(
            record.made["natural"]["mean_delta_e"], abs=1e-6
        )
    if natural.feature_cm:
        assert len(np.unique(texels, axis=0)) <= record.made["natural"]["patches"] < len(texels)


@pytest.mark.parametrize("case", ["palette", "patches", "bound", "all"])
def test_the_loss_falls_under_every_constraint(
    dataset: Dataset, small_detector: Any, tmp_path: Path, case: str
) -> None:
    run(dataset, small_detector, tmp_path / "out", CASES[case], steps=40, batch=6, roa=False, beta=0.0)
    history = [line["attack"] for line in read_history(tmp_path / "out")]
    assert min(history[-5:]) < history[0]


def test_the_loss_told_is_that_of_the_hard_map(dataset: Dataset, small_detector: Any) -> None:
    """A step's loss is computed on palette colors: put in the place of free texels, they give the same bits."""
    natural = make_settings(**(SMALL | {"natural": CASES["palette"], "beta": 0.0}))
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), natural)
    free = Run(dataset, DetectorEnsemble([small_detector], "car"), make_settings(**(SMALL | {"beta": 0.0})))
    with torch.no_grad():
        free.texture.parameter.copy_(run.texture.texels())
    seen = {tuple(row) for row in np.rint(free.texture.texels().detach().numpy() * 255).tolist()}
    assert seen <= {tuple(row) for row in palette_bytes(PALETTE).astype(float).tolist()}
    assert run.advance().attack == free.advance().attack
    run.close()
    free.close()


def test_a_weight_draws_the_paint_to_the_reference(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    natural, found = Naturalness(reference="#8c8c8c"), []
    for gamma in (0.0, 100.0):
        more = {"prior": "reference", "gamma": gamma, "steps": 15}
        _, record = run(dataset, small_detector, tmp_path / f"{gamma:g}", natural, **more)
        found.append(record.made["natural"]["mean_delta_e"])
    assert found[1] < 0.6 * found[0]


def test_references_as_map_photograph_and_color(box_vehicle: Vehicle, tmp_path: Path) -> None:
    """With a bound of 0 the camouflage is the reference."""
    atlas = Pyramid.of(box_vehicle, 64)
    pixels = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    camouflage = Camouflage("old", "box", box_vehicle.atlas_id, 64, "random")
    save_camouflage(tmp_path / "old.json", camouflage, png_bytes(pixels))
    for given, width in ((tmp_path / "old.json", 2.0), (tmp_path / "old.png", None)):
        wanted = Naturalness(reference=str(given), reference_width_m=width, reference_sha256=fingerprint(str(given)))
        assert np.array_equal(reference_texels(box_vehicle, atlas, wanted), pixels.reshape(-1, 3)[atlas.texels])
    Image.fromarray(np.full((30, 50, 3), (10, 200, 90), np.uint8)).save(tmp_path / "photo.jpg", quality=100)
    photo = reference_texels(box_vehicle, atlas, Naturalness(reference=str(tmp_path / "photo.jpg")))
    assert np.abs(photo.astype(int) - (10, 200, 90)).max() <= 3
    stranger = Camouflage("other", "van", "0" * 16, 64, "random")
    save_camouflage(tmp_path / "other.json", stranger, png_bytes(pixels))
    with pytest.raises(RaucaError, match="in another UV layout"):
        reference_texels(box_vehicle, atlas, Naturalness(reference=str(tmp_path / "other.json")))
    changed = Naturalness(reference=str(tmp_path / "old.json"), reference_sha256="0" * 64)
    with pytest.raises(RaucaError, match="changed"):
        reference_texels(box_vehicle, atlas, changed)


def test_the_bound_that_a_refusal_names_is_taken(box_vehicle: Vehicle) -> None:
    """White is 7.302 from this grey: 7.3 would be refused in turn."""
    atlas, asked = Pyramid.of(box_vehicle, 64), {"palette": ("#ffffff",), "reference": "#eaeaea"}
    with pytest.raises(RaucaError, match=r"allow 7\.4 or"):
        Constraints(box_vehicle, atlas, Naturalness(**asked, max_delta_e=7.3), 0)
    Constraints(box_vehicle, atlas, Naturalness(**asked, max_delta_e=7.4), 0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--palette", "#12"], "#rrggbb"),
        (["--max-delta-e", "5"], "--reference"),
        (["--feature-size", "-3"], "--feature-size"),
        (["--reference", "none.png"], "not found"),
        (["--reference-weight", "1"], "--reference"),
        (["--reference", "#8c8c8c", "--palette", "#ff0000", "--max-delta-e", "5"], "palette"),
        (["--palette", "#102030", "--paint", "facets"], "texels"),
        (["--palette", "#102030", "--limit", "tanh"], "--limit"),
    ],
)
def test_mistakes_are_told(dataset: Dataset, tmp_path: Path, options: list[str], words: str) -> None:
    arguments = [
        "optimize",
        str(dataset.folder),
        "--detector",
        "yolov3-tiny",
        "--out",
        str(tmp_path / "out"),
        "--steps",
        "1",
        "--map-size",
        "64",
    ]
    done = CliRunner().invoke(app, [*arguments, *options])
    assert isinstance(done.exception, RaucaError)
    assert words in str(done.exception)
    assert "\n" not in str(done.exception)
    assert not (tmp_path / "out" / "camouflage.json").exists()


def test_where_a_reference_lies_is_no_part_of_a_run(tmp_path: Path) -> None:
    identities = []
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        picture = tmp_path / folder / "forest.png"
        picture.write_bytes(png_bytes(np.full((4, 4, 3), 90, np.uint8)))
        identities.append(make_settings(natural=make_naturalness(reference=str(picture))).identity())
    assert identities[0] == identities[1]
    assert str(tmp_path) not in json.dumps(identities)
    picture.write_bytes(png_bytes(np.full((4, 4, 3), 91, np.uint8)))
    assert make_settings(natural=make_naturalness(reference=str(picture))).identity() != identities[0]
