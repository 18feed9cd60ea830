"""Files that are cut short or have a bit flipped after they were written: found by name, and mended by the job."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import RaucaError
from rauca_core.dataset_tools import check_dataset
from rauca_core.environment import load_extractor
from rauca_core.runtime.images import read_image
from tests.faults.jobs import EVALUATE, MAKE, NO_BLENDER, OPTIMIZE, POINTER, TRAIN, Begun, GoesOn, Inputs, Job
from tests.faults.running import rauca

Folder = Callable[[Job], Path]
WRITTEN = "its bytes are not those that were written"


def flip(path: Path) -> None:
    """One bit in the middle."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


def cut(path: Path) -> None:
    """The second half is lost."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def check(folder: Path, *options: str) -> list[str]:
    """What `rauca dataset check` finds, a line each."""
    done = CliRunner().invoke(app, ["dataset", "check", str(folder), "--unfinished", *options])
    lines = [line for line in done.stdout.splitlines() if "; " in line]
    assert done.exit_code == (2 if lines else 0), done.output
    return lines


@NO_BLENDER
def test_frames_of_a_data_set(goes_on: GoesOn, begun: Begun, tmp_path: Path) -> None:
    """`check` names every damaged file and removes its frame when asked; the same command renders it again."""
    out = begun(MAKE, tmp_path / "out")
    frame = next(out.glob("frames/*"))
    assert check(out) == []
    flip(frame / "passes.npz")
    cut(frame / "image.png")
    flip(out / "vehicle" / "mesh.npz")
    damaged = (f"frames/{frame.name}/image.png", f"frames/{frame.name}/passes.npz", "vehicle/mesh.npz")
    found = check(out, "--remove-damaged")
    for name in damaged:
        assert any(line.startswith(f"{name}: {WRITTEN}") for line in found), (name, found)
    assert not frame.exists()
    goes_on(MAKE, out)
    assert check(out) == []


@NO_BLENDER
def test_vehicle_of_a_data_set(goes_on: GoesOn, finished: Folder, tmp_path: Path) -> None:
    """It comes back to the byte, although no frame is missing and so no worker is started."""
    out = tmp_path / "out"
    shutil.copytree(finished(MAKE), out)
    flip(out / "vehicle" / "mesh.npz")
    check(out, "--remove-damaged")
    assert not (out / "vehicle").exists()
    goes_on(MAKE, out)
    assert check(out) == []


@pytest.mark.parametrize(
    ("job", "name", "spoil"),
    [
        pytest.param(OPTIMIZE, "passes.npz", cut, id="optimize"),
        pytest.param(TRAIN, "image.png", flip, id="efe-train"),
        pytest.param(EVALUATE, "image.png", flip, id="evaluate"),
    ],
)
def test_frames_that_are_read(
    job: Job, name: str, spoil: Callable[[Path], None], inputs: Inputs, goes_on: GoesOn, tmp_path: Path
) -> None:
    """A job that meets a damaged frame names the file; `check` does too; it goes on once the frame is whole."""
    data, out = tmp_path / "data", tmp_path / "out"
    shutil.copytree(inputs.data, data)
    victim = sorted(data.glob(f"frames/*/{name}"))[3]
    spoil(victim)
    complaint = rauca(job.words(replace(inputs, data=data), out), tmp_path / "log").complaint
    assert str(victim) in complaint
    (found,) = (f for f in check_dataset(data).findings if WRITTEN in f.what)
    assert data / found.file == victim
    shutil.copy(inputs.data / victim.relative_to(data), victim)
    goes_on(job, out, data=data)


def test_camouflage(goes_on: GoesOn, finished: Folder, tmp_path: Path) -> None:
    """A finished run makes its products again, from a checkpoint that knows its own bytes."""
    out = tmp_path / "out"
    shutil.copytree(finished(OPTIMIZE), out)
    flip(out / "camouflage.png")
    with pytest.raises(RaucaError, match=r"camouflage\.png: not a readable image"):
        read_image(out / "camouflage.png")
    goes_on(OPTIMIZE, out)


@pytest.mark.parametrize("job", [OPTIMIZE, TRAIN], ids=["optimize", "efe-train"])
def test_checkpoint(job: Job, inputs: Inputs, finished: Folder, tmp_path: Path) -> None:
    """A bit that is flipped in a checkpoint is never trained on."""
    out = tmp_path / "out"
    shutil.copytree(finished(job), out)
    (tensors,) = (out / POINTER).parent.glob("*.safetensors")
    flip(tensors)
    complaint = rauca(job.words(inputs, out), tmp_path / "log").complaint
    assert f"{tensors}: missing or damaged ({WRITTEN})" in complaint


def test_weights(finished: Folder, tmp_path: Path) -> None:
    """Weights are held against their card before anything uses them."""
    out = tmp_path / "out"
    shutil.copytree(finished(TRAIN), out)
    load_extractor(out / "light-splitter.safetensors")
    flip(out / "light-splitter.safetensors")
    with pytest.raises(RaucaError, match="is not the file that its card describes"):
        load_extractor(out / "light-splitter.safetensors")


def test_what_an_evaluation_keeps(goes_on: GoesOn, finished: Folder, tmp_path: Path) -> None:
    """Defended images and detections are made again where they are damaged."""
    out = tmp_path / "out"
    shutil.copytree(finished(EVALUATE), out)
    flip(next(out.glob("store/defended/*/*.png")))
    cut(next(out.glob("store/detections/*/*.jsonl")))
    goes_on(EVALUATE, out)
