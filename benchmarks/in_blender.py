"""Blender for benchmarks: a child process that measures, and data sets that are rendered once and kept."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pipelines.console import progress_bar
from pipelines.dataset_options import dataset_job, dataset_parser
from rauca_core.contract import (
    Dataset,
    Progress,
    RaucaError,
    Vehicle,
    Weather,
    find_preset,
)
from rauca_core.contract.files import write_json
from rauca_core.dataset_tools.stored import FILES, load_vehicle
from rauca_core.runtime.blender import require_bpy, run_blender, run_commands

ROOT = Path(__file__).resolve().parent.parent


def run_child(function: str, request: Mapping[str, Any], move: Callable[[Progress], None], instead: str = "") -> None:
    """Call a function of the benchmarks, ``module.name``, in a process of its own with bpy; it answers by files.

    Raises:
        RaucaError: Blender is missing, and ``instead`` would do; the function raised one, or its process died.
    """
    require_bpy(instead)
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from benchmarks.in_blender import child; child()"
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        path = Path(temporary) / "request.json"
        write_json(path, request)
        run_commands(function, [[sys.executable, "-c", code, function, str(path)]], move)


def child() -> None:
    """What the process of :func:`run_child` does."""
    module, _, name = sys.argv[1].rpartition(".")
    request = json.loads(Path(sys.argv[2]).read_text())
    try:
        getattr(importlib.import_module(f"benchmarks.{module}"), name)(**request)
    except RaucaError as error:
        sys.exit(f"error: {error}")


def children_s() -> float:
    """CPU seconds of all processes that this one has started and that have ended."""
    used = os.times()
    return used.children_user + used.children_system


class Wanted(NamedTuple):
    """A data set to make; ``options`` are those of ``rauca dataset make`` but for out, vehicle and weathers."""

    name: str
    vehicle: str
    weathers: tuple[Weather, ...]
    options: str

    @property
    def folder_name(self) -> str:
        """By what it holds: other weathers or options make another folder."""
        text = json.dumps([self.vehicle, [w.to_json() for w in self.weathers], self.options])
        return f"{self.name}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def weathers_of(names: Sequence[str]) -> tuple[Weather, ...]:
    """Weathers by name, from the presets ``base``, ``unseen`` and ``demo``."""
    known = {w.name: w for preset in ("demo", "unseen", "base") for w in find_preset(preset)}
    return tuple(known[name] for name in names)


def save_weathers(path: Path, weathers: Sequence[Weather]) -> None:
    """Write a preset file in place of the one that may be there."""
    write_json(path, {"format": "rauca-weathers", "version": 1, "weathers": [one.to_json() for one in weathers]})


def make_dataset(wanted: Wanted, folder: Path) -> Dataset:
    """Render a data set below ``folder``, or go on with it, or open it when it is whole."""
    out = folder / wanted.folder_name
    found = Dataset(out) if (out / "dataset.json").is_file() else None
    # Occluded frames are never there, and asking for them again is cheap.
    if found is None or len(found.frames()) < len(found.plan.frames()):
        preset = folder / f"{wanted.folder_name}.json"
        save_weathers(preset, wanted.weathers)
        chosen = ["--out", str(out), "--vehicle", wanted.vehicle, "--weathers", str(preset), *wanted.options.split()]
        with progress_bar(f"rendering {wanted.name}") as move:
            run_blender(dataset_job(dataset_parser().parse_args(chosen)), move)
    return Dataset(out)


def open_vehicle(name_or_path: str, paint_mask: Path | None = None, paint_material: str | None = None) -> Vehicle:
    """As `load_vehicle`; where a file is given and Blender is missing, a benchmark can do with a folder."""
    if Path(name_or_path).suffix.lower() in FILES:
        require_bpy("give a vehicle folder")
    return load_vehicle(name_or_path, paint_mask, paint_material)
