"""The long jobs, each as a command line with a tiny input, and how to tell what it is doing and what it has made."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

Content = dict[str, Any]
Whole = Callable[["Job"], Content]
Begun = Callable[["Job", Path], Path]
GoesOn = Callable[..., None]
"""What fixtures hand out, see `conftest`."""
POINTER = "checkpoints/checkpoint.json"
NO_BLENDER = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="the bpy wheel is not installed")


@dataclass(frozen=True)
class Inputs:
    """What jobs work on.

    Attributes:
        data: a data set.
        detector: weights of a small network.
    """

    data: Path
    detector: Path


@dataclass(frozen=True)
class Job:
    """One long job.

    Attributes:
        name: what stands after ``rauca``.
        options: that make it small.
        pulse: a value that changes in the folder of a job each time that it has got further.
        content: what a finished folder holds, equal for equal work.
        reads: it works on a data set.
        detector: the option that names one; "" for none.
        marks: of the test parameter.
    """

    name: str
    options: str
    pulse: Callable[[Path], object]
    content: Callable[[Path], Content]
    reads: bool = True
    detector: str = ""
    marks: tuple[pytest.MarkDecorator, ...] = ()

    def words(self, inputs: Inputs, out: Path) -> list[str]:
        """What a user types after ``rauca``, the first time or after a fault."""
        given = [str(inputs.data)] if self.reads else []
        given += [self.detector, str(inputs.detector)] if self.detector else []
        return [*self.name.split(), *given, *self.options.split(), "--out", str(out)]


def files(folder: Path, *patterns: str) -> Content:
    """The bytes of files below a folder."""
    found = (path for pattern in patterns for path in folder.glob(pattern) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def each(*jobs: Job) -> pytest.MarkDecorator:
    """Runs a test once for each job."""
    return pytest.mark.parametrize(
        "job", [pytest.param(job, id=job.name.replace(" ", "-"), marks=job.marks) for job in jobs]
    )


def _lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def _optimized(out: Path) -> Content:
    history = [(line["step"], line["loss"], line["score"]) for line in _lines(out / "history.jsonl")]
    return files(out, "camouflage.*", "checkpoints/*") | {"history": history}


def _pictured(out: Path) -> int:
    picture = out / "preview.png"  # renewed at steps and checkpoints
    return picture.stat().st_mtime_ns if picture.is_file() else 0


def _trained(out: Path) -> Content:
    card = json.loads((out / "light-splitter.json").read_text())
    errors = {line["epoch"]: line["mae"] for line in _lines(out / "rounds.jsonl")}
    return files(out, "*.safetensors", "checkpoints/*") | {"metrics": card["metrics"], "errors": errors}


def _epochs(out: Path) -> int:
    ledger = out / "rounds.jsonl"
    return len(ledger.read_text().splitlines()) if ledger.is_file() else -1


def _evaluated(out: Path) -> Content:
    results = {str(path.relative_to(out)): json.loads(path.read_text()) for path in out.glob("box/*/*/results.json")}
    for result in results.values():  # images are told by where they lie, too, and that is another place in each test
        result["images"] = {paint: [image["sha256"] for image in rows] for paint, rows in result["images"].items()}
    return files(out, "store/defended/*/*.png") | results


def _detected(out: Path) -> int:
    return sum(len(path.read_bytes().splitlines()) for path in out.glob("store/detections/*/*.jsonl"))


def _rendered(out: Path) -> int:
    return sum((frame / "frame.json").is_file() for frame in out.glob("frames/L*"))


MAKE = Job(
    "dataset make",
    "--azimuths 5 --elevations 15 --distances 6 --weathers single --size 64 --samples 1 --no-denoise --min-visible 0",
    _rendered,
    lambda out: files(out, "dataset.json", "SHA256SUMS", "vehicle/*", "frames/*/*"),
    reads=False,
    marks=(NO_BLENDER,),
)
OPTIMIZE = Job(
    "optimize",
    # Long enough that the disk is full, or the process dead, before it is done on a busy machine.
    "--steps 96 --batch 1 --map-size 32 --samples 2 --threads 1",
    _pictured,
    _optimized,
    detector="--detector",
)
TRAIN = Job(
    "efe train",
    "--epochs 3 --batch 3 --split view --crop 16 --threads 1",
    _epochs,
    _trained,
)
EVALUATE = Job(
    "evaluate",
    "--defences none,bits,jpeg",
    _detected,
    _evaluated,
    detector="--detectors",
)
LEARNING = (OPTIMIZE, TRAIN, EVALUATE)  # from a drawn data set: no Blender
JOBS = (MAKE, *LEARNING)
