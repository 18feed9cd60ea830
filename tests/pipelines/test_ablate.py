"""``rauca ablate`` at thumbnail size: real Blender, real detector, real optimizer; and what it keeps when it stops."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import Dataset, RaucaError
from rauca_core.detect.load import resolve
from rauca_core.study.artifact import read_recipe
from rauca_core.study.study import load_study
from tests.published import published_weights
from tests.study.drawn_blender import DrawnBlender, drawn_blender

__all__ = ["drawn_blender"]
SMALL = ["--frames", 8, "--held-out", 2, "--size", 64, "--samples", 1, "--steps", 2, "--batch", 2, "--map-size", 64]
SMALL += ["--detectors", "yolov3-tiny", "--threads", 1]


def ablate(*arguments: object) -> str:
    return CliRunner().invoke(app, ["ablate", *map(str, arguments)], catch_exceptions=False).output


def written(folder: Path) -> dict[str, int]:
    """Every file that took work, and when it was written."""
    kinds = (".png", ".npz", ".safetensors")
    return {str(p.relative_to(folder)): p.stat().st_mtime_ns for p in folder.rglob("*") if p.suffix in kinds}


def test_an_ablation_from_views_to_verdicts_and_again(tmp_path: Path) -> None:
    published_weights("yolov3-tiny")
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
    out, data = tmp_path / "views", tmp_path / "data"
    asked = ["views", "--quick", "--out", out, *SMALL]
    ablate(*asked)
    (entry,) = load_study(out).entries
    assert entry.results.paints == ("normal", "random", "share-08th", "all")
    (whole,), (part,) = (list((data / "views").glob("enhanced-*")), list((data / "part").iterdir()))
    assert {f.id for f in Dataset(part).frames()} < {f.id for f in Dataset(whole).frames()}
    found = json.loads((out / "ablation.json").read_text())
    assert [v["by"] for v in found["verdicts"]] == ["this project"]  # of the variants of the quick size
    assert "All views below 1/8 of the views" in (out / "ablation.html").read_text()

    before = written(data)
    (out / "ablation.html").unlink()
    ablate(*asked)
    assert (out / "ablation.html").is_file()
    assert written(data) == before  # nothing was made twice

    lost = next(data.glob("renders/all-*/*.png"))
    lost.unlink()
    ablate(*asked)
    again = written(data)
    assert {name for name in again if again[name] != before[name]} == {str(lost.relative_to(data))}


def test_mistakes_are_told_before_anything_is_made(tmp_path: Path) -> None:
    published_weights("yolov3-tiny")
    for asked, told in (
        (("nothing",), "ablation: no 'nothing'; choose one of baselines"),
        (("beta", "--variants", "beta-0,x"), "beta: no variant 'x'; choose of beta-100"),
        (("beta", "--weathers", "hail"), "weather preset 'hail' is unknown"),
        (("beta", "--attack", "nobody"), "nobody"),
        (("beta", "--detectors", "yolov3-tiny", "--lr", 5), "lr: input should be less than or equal to 1, not 5.0"),
        (("beta", "--slurm", "nodes=2"), "--slurm nodes=2: 'nodes=2' is none of kind, partition"),
    ):
        with pytest.raises(RaucaError, match=told):
            ablate(*asked, "--out", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_weights_of_ones_own_are_attacked(tmp_path: Path, drawn_blender: DrawnBlender) -> None:
    published_weights("yolov3-tiny")
    mine = tmp_path / "mine.weights"
    content = bytearray(resolve("yolov3-tiny").files[0].read_bytes())
    content[-4000:] = bytes(4000)
    mine.write_bytes(content)
    for typed in ("yolov3-tiny", f"yolov3-tiny={mine}"):
        asked = ["beta", "--quick", "--variants", "beta-0", *SMALL, "--attack", typed, "--weathers", "single"]
        ablate(*asked, "--out", tmp_path / "out", "--data", tmp_path / "data")
    made = [read_recipe(folder)[0] for folder in (tmp_path / "data" / "paint").iterdir()]
    assert {tuple(one.options["detectors"]) for one in made} == {("yolov3-tiny",), (f"yolov3-tiny={mine}",)}
    assert len({one.settings["detectors"][0] for one in made}) == 2
