"""Frames rendered anew by Blender in a child process, kept on disk by what they show."""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.child import run_child
from pipelines.console import progress_bar
from rauca_core.contract import Dataset
from rauca_core.contract.files import write_json
from rauca_core.runtime.blender import require_bpy

SCRIPT = Path(__file__).with_name("cycles_light.py")
LIGHT = "light"


class Render(NamedTuple):
    """A frame, in a camouflage or as light maps, with a budget and a seed; the whole of it, or where it shows paint."""

    frame: str
    paint: str
    samples: int
    seed: int = 1
    denoise: bool = False
    whole: bool = False


def render_anew(
    dataset: Dataset, camouflages: Mapping[str, Path], wanted: Sequence[Render], folder: Path
) -> dict[Render, dict[str, Any]]:
    """Arrays of every render, see `cycles_light`; those already in ``folder`` are read.

    Raises:
        RaucaError: Blender is missing, or died.
    """
    paths = {render: folder / f"{_name(dataset, camouflages, render)}.npz" for render in wanted}
    weather_of = {frame.id: (frame.location, frame.weather.name) for frame in dataset.frames()}
    missing = sorted((r for r in paths if not paths[r].is_file()), key=lambda r: (weather_of[r.frame], r.paint, r))
    if missing:
        jobs = [{**render._asdict(), "name": paths[render].stem} for render in missing]
        request = {
            "dataset": str(dataset.folder.absolute()),
            "camouflages": {name: str(path.absolute()) for name, path in camouflages.items()},
            "out": str(folder.absolute()),
            "jobs": jobs,
        }
        _run(request)
    found = {}
    for render, path in paths.items():
        with np.load(path) as archive:
            found[render] = dict(archive)
    return found


def _name(dataset: Dataset, camouflages: Mapping[str, Path], render: Render) -> str:
    painted = "" if render.paint == LIGHT else hashlib.sha256(
        camouflages[render.paint].with_suffix(".png").read_bytes()
    ).hexdigest()  # fmt: skip
    text = json.dumps([dataset.plan.to_json(), painted, *render], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _run(request: dict[str, Any]) -> None:
    require_bpy()
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary, progress_bar("Cycles", resumes=False) as move:
        path = Path(temporary) / "request.json"
        write_json(path, request)
        command = [sys.executable, "-P", str(SCRIPT), str(path)]
        run_child("environment", command, move)
