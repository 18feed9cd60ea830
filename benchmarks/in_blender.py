"""Blender for benchmarks: a child process that measures, and data sets that are rendered once and kept."""

from __future__ import annotations

import hashlib
import importlib
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pipelines.console import goes_on_by_itself, progress_bar
from pipelines.dataset_options import dataset_job, dataset_parser
from rauca_core.contract import (
    Dataset,
    Progress,
    RaucaError,
    Vehicle,
    VehicleSource,
    Weather,
    find_preset,
    load_vehicle,
    save_weathers,
)
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import write_json
from rauca_core.runtime.blender import require_bpy, run_blender, run_command
from rauca_core.runtime.images import read_image

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
        run_command(function, [sys.executable, "-c", code, function, str(path)], move)


def child() -> None:
    """What the process of :func:`run_child` does."""
    module, _, name = sys.argv[1].rpartition(".")
    request = json.loads(Path(sys.argv[2]).read_text())
    try:
        getattr(importlib.import_module(f"benchmarks.{module}"), name)(**request)
    except RaucaError as error:
        sys.exit(f"error: {error}")


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


def make_dataset(wanted: Wanted, folder: Path) -> Dataset:
    """Render a data set below ``folder``, or go on with it, or open it when it is whole."""
    out = folder / wanted.folder_name
    found = Dataset(out) if (out / "dataset.json").is_file() else None
    # Occluded frames are never there, and asking for them again is cheap.
    if found is None or len(found.frames()) < len(found.plan.frames()):
        preset = folder / f"{wanted.folder_name}.json"
        save_weathers(preset, wanted.weathers)
        chosen = ["--out", str(out), "--vehicle", wanted.vehicle, "--weathers", str(preset), *wanted.options.split()]
        with goes_on_by_itself(), progress_bar(f"rendering {wanted.name}") as move:
            run_blender(dataset_job(dataset_parser().parse_args(chosen)), move)
    return Dataset(out)


def open_vehicle(name_or_path: str, paint_mask: Path | None = None, paint_material: str | None = None) -> Vehicle:
    """A shipped vehicle, a vehicle folder, or an .obj, .glb or .blend, imported in a process of its own.

    Raises:
        RaucaError: no such vehicle, nothing paintable, paint chosen for one that brings its own, or Blender is missing.
    """
    for folder in (assets_folder() / "vehicles" / name_or_path, Path(name_or_path)):
        if (folder / "vehicle.json").is_file():
            if paint_mask or paint_material:
                raise RaucaError(f"--vehicle {name_or_path} brings its own paint; drop the paint option")
            return load_vehicle(folder, read_image)
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary) / "vehicle"
        source = {"path": name_or_path, "mask": str(paint_mask or ""), "material": paint_material}
        request = {**source, "out": str(folder)}
        run_child("in_blender.import_vehicle", request, lambda progress: None, "give a vehicle folder")
        return load_vehicle(folder, read_image)


def import_vehicle(path: str, mask: str, material: str | None, out: str) -> None:
    """In the child process: import a vehicle file and save it as a vehicle folder."""
    import bpy  # noqa: F401  # Blender's own modules, addon_utils among them, are found once it is there

    from blender_addon.scene.vehicle_files import find_vehicle

    find_vehicle(VehicleSource(path, Path(mask) if mask else None, material)).save(Path(out))
