"""Blender for benchmarks: a child process that measures, and data sets that are rendered once and kept."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

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
    parse_progress,
)
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import write_json
from rauca_core.contract.presets import PRESET_FORMAT
from rauca_core.runtime.blender import require_bpy, run_blender
from rauca_core.runtime.images import read_image

ROOT = Path(__file__).resolve().parent.parent


def run_child(
    module: str, arguments: Sequence[object], progress: Callable[[Progress], None], instead: str = ""
) -> None:
    """Run a module of this checkout that imports bpy, ``python -m MODULE ARGUMENTS``, and pass its progress on.

    Args:
        instead: what would do where Blender is missing.

    Raises:
        RaucaError: Blender is missing, or the module ended with another code than 0; what it wrote last tells why.
    """
    require_bpy(instead)
    process = subprocess.Popen(
        [sys.executable, "-m", module, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    tail = "no message"
    try:
        for line in process.stdout or ():
            if news := parse_progress(line):
                progress(news)
            elif line.strip():
                tail = line.strip()
        code = process.wait()
    except BaseException:
        process.kill()
        process.wait()
        raise
    if tail.startswith("error: "):
        raise RaucaError(tail.removeprefix("error: "))
    if code:
        raise RaucaError(f"{module}: Blender stopped with code {code}: {tail}")


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
    """Weathers by name, from the presets ``base`` and ``unseen``."""
    folder = assets_folder() / "weathers"
    known = {w.name: w for preset in ("unseen", "base") for w in find_preset(preset, folder)}
    return tuple(known[name] for name in names)


def make_dataset(wanted: Wanted, folder: Path) -> Dataset:
    """Render a data set below ``folder``, or go on with it, or open it when it is whole."""
    out = folder / wanted.folder_name
    if not (out / "dataset.json").is_file() or _unfinished(Dataset(out)):
        name, version = PRESET_FORMAT
        preset = folder / f"{wanted.folder_name}.json"
        write_json(preset, {"format": name, "version": version, "weathers": [w.to_json() for w in wanted.weathers]})
        chosen = ["--out", str(out), "--vehicle", wanted.vehicle, "--weathers", str(preset), *wanted.options.split()]
        with goes_on_by_itself(), progress_bar(f"rendering {wanted.name}") as move:
            run_blender(dataset_job(dataset_parser().parse_args(chosen)), move)
    return Dataset(out)


def _unfinished(dataset: Dataset) -> bool:
    """Occluded frames are never there, and asking for them again is cheap."""
    return len(dataset.frames()) < len(dataset.plan.frame_ids())


def open_vehicle(name_or_path: str, paint_mask: Path | None = None, paint_material: str | None = None) -> Vehicle:
    """A shipped vehicle, a vehicle folder, or an .obj, .glb or .blend that Blender imports in a process of its own.

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
        arguments = [name_or_path, paint_mask or "", paint_material or "", folder]
        run_child("benchmarks.in_blender", arguments, lambda progress: None, "give a vehicle folder")
        return load_vehicle(folder, read_image)


def _import_vehicle(name: str, mask: str, material: str, out: str) -> None:
    """In the child process: import a vehicle file and save it as a vehicle folder."""
    from blender_addon.vehicles import find_vehicle

    try:
        find_vehicle(VehicleSource(name, Path(mask) if mask else None, material or None)).save(Path(out))
    except RaucaError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    _import_vehicle(*sys.argv[1:])
