"""The data sets of the benchmark, rendered once and kept beside its figures: remove the folder to render them anew."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipelines.console import progress_bar
from pipelines.going_on import goes_on_by_itself
from rauca_core.contract import Dataset, RaucaError, Weather, find_preset
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import write_json
from rauca_core.contract.presets import PRESET_FORMAT
from rauca_core.runtime.blender import run_blender

from .settings import Settings

TRAIN_SEED, TEST_SEED = 11, 12  # other streets, other cameras
JITTER = "--jitter-azimuth 40 --jitter-elevation 8 --jitter-distance 0.2 --jitter-aim 0.2 --min-visible 0.4"


@dataclass(frozen=True)
class Wanted:
    """One data set to make."""

    name: str
    vehicle: str
    weathers: tuple[Weather, ...]
    options: str

    @property
    def folder_name(self) -> str:
        text = json.dumps([self.vehicle, [w.to_json() for w in self.weathers], self.options])
        return f"{self.name}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def weathers_of(names: Sequence[str]) -> tuple[Weather, ...]:
    """Weathers by name, from the presets ``base`` and ``unseen``."""
    folder = assets_folder() / "weathers"
    known = {w.name: w for preset in ("unseen", "base") for w in find_preset(preset, folder)}
    missing = [name for name in names if name not in known]
    if missing:
        raise RaucaError(f"weathers {', '.join(missing)}: in neither preset, base nor unseen; restore the presets")
    return tuple(known[name] for name in names)


def sedan_data(settings: Settings) -> Wanted:
    """The sedan, in seen weathers."""
    views = f"--azimuths {settings.azimuths} --distances {_list(settings.distances_m)}"
    return _wanted("train", "sedan", settings.seen, settings, f"--locations {settings.locations} {views}", TRAIN_SEED)


def held_out_data(settings: Settings) -> Wanted:
    """The sedan, in seen and unseen weathers."""
    views = f"--azimuths {settings.test_azimuths} --distances {_list(settings.distances_m)}"
    weathers = (*settings.seen, *settings.unseen)
    return _wanted("test", "sedan", weathers, settings, f"--locations 1 {views}", TEST_SEED)


def default_data(settings: Settings) -> Wanted:
    """The sedan nearby in all weathers, at the default budget: what exact maps are judged on."""
    views = f"--locations 1 --azimuths 1 --distances {settings.distances_m[0]:g}"
    whole = replace(settings, size=settings.exact_size)
    return _wanted("default", "sedan", (*settings.seen, *settings.unseen), whole, views, TEST_SEED)


def vehicle_data(vehicle: str, settings: Settings) -> tuple[Wanted, Wanted]:
    """Another vehicle, to fine-tune on in seen weathers, and to test on in unseen ones."""
    near = f"--distances {settings.distances_m[0] * 1.5}"
    many = f"--locations {settings.vehicle_locations} --azimuths {settings.vehicle_azimuths} {near}"
    few = f"--locations 1 --azimuths 2 {near}"
    train = _wanted(vehicle, vehicle, settings.seen, settings, many, TRAIN_SEED)
    return train, _wanted(f"{vehicle}-unseen", vehicle, settings.unseen, settings, few, TEST_SEED)


def make(wanted: Wanted, folder: Path) -> Dataset:
    """Render a data set below ``folder``, or go on with it, or open it when it is whole."""
    out = folder / wanted.folder_name
    if not (out / "dataset.json").is_file() or _unfinished(Dataset(out)):
        name, version = PRESET_FORMAT
        preset = folder / f"{wanted.folder_name}.json"
        write_json(preset, {"format": name, "version": version, "weathers": [w.to_json() for w in wanted.weathers]})
        chosen = ["--out", str(out), "--vehicle", wanted.vehicle, "--weathers", str(preset), *wanted.options.split()]
        with goes_on_by_itself(), progress_bar(f"rendering {wanted.name}") as move:
            run_blender("make_dataset", [*chosen, "--json-progress"], move)
    return Dataset(out)


def _unfinished(dataset: Dataset) -> bool:
    """Occluded frames are never there, and asking for them again is cheap."""
    return len(dataset.frames()) < len(dataset.plan.frame_ids())


def _wanted(name: str, vehicle: str, weathers: Sequence[str], settings: Settings, views: str, seed: int) -> Wanted:
    options = f"--size {settings.size} --samples {settings.samples} --elevations 12 {views} {JITTER} --seed {seed}"
    return Wanted(name, vehicle, weathers_of(weathers), options)


def _list(values: Sequence[float]) -> str:
    return ",".join(f"{v:g}" for v in values)
