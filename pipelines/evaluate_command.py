"""``rauca evaluate``: from what the user types to a checked request; mistakes are told before anything is rendered."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from rauca_core.contract import Dataset, RaucaError, find_preset
from rauca_core.contract.assets import assets_folder

from .console import console, output
from .dataset_commands import Blender
from .going_on import goes_on_by_itself

if TYPE_CHECKING:
    from rauca_core.detect import Detector
    from rauca_core.study.contestants import VehicleChoice
    from rauca_core.study.study import Entry
    from rauca_core.study.views import HeldOut

ALL = "all"
Given = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[DATASET|CAMOUFLAGE]...", help="views to evaluate on instead of new ones; more camouflages"
    ),
]
Camouflages = Annotated[
    list[str] | None, typer.Option(help="camouflage .json, or LABEL=FILE; several, comma separated or repeated")
]
Out = Annotated[Path, typer.Option(help="folder of the study; run again to resume")]
Detectors = Annotated[
    list[str] | None, typer.Option("--detectors", "--detector", help="names or paths, comma separated; or all")
]
Weathers = Annotated[list[str] | None, typer.Option(help="seen, unseen, both, or a preset's name or .json file")]
Defences = Annotated[
    list[str] | None,
    typer.Option("--defences", "--defence", help="none, lgs, pad, jpeg, bits, median; comma separated"),
]
Vehicles = Annotated[
    list[str] | None, typer.Option(help="vehicle folder or shipped name; found by the camouflage's UV atlas if shipped")
]


def evaluate(
    out: Out,
    given: Given = None,
    camouflage: Camouflages = None,
    detectors: Detectors = None,
    weathers: Weathers = None,
    defences: Defences = None,
    vehicle: Vehicles = None,
    scale: Annotated[str, typer.Option(help="quick (32 frames per weather set), standard (128) or full (1024)")] = (
        "standard"
    ),
    frames: Annotated[int | None, typer.Option(min=1, help="frames per weather set, instead of a scale")] = None,
    ring: Annotated[
        str, typer.Option(help="street (0 to 24 degrees up, 5 to 16 m away) or paper (0 to 67.5 degrees, 5 to 20 m)")
    ] = "street",
    elevations: Annotated[str | None, typer.Option(help="of the cameras, degrees; the ring's by default")] = None,
    distances: Annotated[
        str | None,
        typer.Option(help="of the cameras, metres; the ring's by default, farther for large vehicles"),
    ] = None,
    size: Annotated[int, typer.Option(min=16, help="frames are square, pixels")] = 320,
    samples: Annotated[int, typer.Option(min=1, help="Cycles samples per pixel before denoising")] = 8,
    views_seed: Annotated[int | None, typer.Option(min=0, help="of the held-out town and its cameras")] = None,
    random: Annotated[bool, typer.Option("--random", help="evaluate in random paint too")] = False,
    random_seed: Annotated[int, typer.Option(min=0)] = 1,
    random_cell: Annotated[int, typer.Option(min=1, help="side of a cell of random paint, texels of 1024")] = 8,
    resamples: Annotated[int, typer.Option(min=1, help="of the bootstrap behind the intervals")] = 1000,
    device: Annotated[str, typer.Option(help="of the detectors")] = "cpu",
    scene: Annotated[Path | None, typer.Option(help="the .blend that DATASET was made in, if it was")] = None,
    blender: Blender = None,
) -> None:
    """Measure AP@0.5 on held-out views: reference paint, camouflages, defences; re-rendered by Cycles."""
    from rauca_core.study.contestants import match, read_contestants
    from rauca_core.study.defences import make_defence

    from .protocol import RandomPaint, Request, run_study

    files = [path for path in given or () if path.suffix in (".json", ".png")]
    datasets = [Dataset(path) for path in given or () if path not in files]
    reserved = ("normal", "random") if random else ("normal",)
    contestants = read_contestants([*split_names(camouflage), *map(str, files)], reserved)
    vehicles = _vehicles(vehicle, datasets)
    matched = match(contestants, vehicles, everyone=bool(vehicle or datasets))
    if not matched:
        raise RaucaError("evaluate: nothing to evaluate; give camouflages, a data set or a --vehicle")
    named = map(make_defence, split_defences(defences) or ["none"])
    request = Request(
        command=shlex.join(["rauca", *sys.argv[1:]]),
        out=out,
        contestants=matched,
        detectors={},
        defences=list({defence.name: defence for defence in named}.values()),  # one may be spelled in several ways
        weathers=weather_sets(split_names(weathers), bool(datasets)),
        held_out=_held_out(frames, scale, ring, elevations, distances, size, samples, views_seed),
        datasets=_by_atlas(datasets),
        random=RandomPaint(random_seed, random_cell) if random else None,
        resamples=resamples,
        device=device,
        blender=blender,
        scene=scene,
    )
    loaded = _detectors(split_names(detectors), list(matched), device)
    with goes_on_by_itself():
        entries = run_study(replace(request, detectors=loaded))
    _print(entries, out)


def split_names(given: Sequence[str] | None) -> list[str]:
    """Values of a repeatable option, each of which may be several, comma separated."""
    return [part for value in given or () for part in value.split(",") if part]


def split_defences(given: Sequence[str] | None) -> list[str]:
    """The same for defences, whose parameters have commas too: ``none,lgs:block=9,overlap=3`` are two."""
    names: list[str] = []
    for part in split_names(given):
        if names and ":" in names[-1] and "=" in part and ":" not in part:
            names[-1] += f",{part}"
        else:
            names.append(part)
    return names


def _vehicles(named: Sequence[str] | None, datasets: Sequence[Dataset]) -> list[VehicleChoice]:
    from rauca_core.study.contestants import find_vehicles, read_vehicle_choice

    if not datasets:
        return find_vehicles(named or ())
    if named:
        raise RaucaError("--vehicle: a data set brings its own vehicle; drop one of the two")
    choices = {dataset.plan.atlas_id: read_vehicle_choice(dataset.vehicle_folder) for dataset in datasets}
    return list(choices.values())


def _by_atlas(datasets: Sequence[Dataset]) -> dict[str, list[Dataset]]:
    result: dict[str, list[Dataset]] = {}
    for dataset in datasets:
        others = result.setdefault(dataset.plan.atlas_id, [])
        if any(other.folder.resolve().name == dataset.folder.resolve().name for other in others):
            raise RaucaError(f"{dataset.folder}: two data sets of one name; results are told apart by it, rename one")
        others.append(dataset)
    return result


def weather_sets(names: Sequence[str], has_datasets: bool) -> list[str]:
    """Weathers of the held-out views, each once and with a file name of its own; their folders are called by it."""
    from .protocol import PRESETS

    if has_datasets:
        if names:
            raise RaucaError("--weathers: a data set brings its own weathers; drop one of the two")
        return []
    chosen = [part for name in names or ("both",) for part in (("seen", "unseen") if name == "both" else (name,))]
    called: dict[str, str] = {}
    for name in chosen:
        find_preset(PRESETS.get(name, name), assets_folder() / "weathers")
        if (other := called.setdefault(Path(name).stem, name)) != name:
            raise RaucaError(f"--weathers {name}: has the name of {other}; results are told apart by it, rename one")
    return list(called.values())


def _held_out(
    frames: int | None,
    scale: str,
    ring_name: str,
    elevations: str | None,
    distances: str | None,
    size: int,
    samples: int,
    seed: int | None,
) -> HeldOut:
    from rauca_core.study.views import TOWN_SEED, HeldOut, find_ring, frames_of_scale

    named = find_ring(ring_name)
    ring = replace(
        named,
        elevations_deg=_numbers("--elevations", elevations) or named.elevations_deg,
        distances_m=_numbers("--distances", distances) or named.distances_m,
    )
    count = frames_of_scale(scale) if frames is None else frames
    town = TOWN_SEED if seed is None else seed
    return HeldOut(count, ring, size=size, samples=samples, seed=town, fit=distances is None)


def _numbers(option: str, text: str | None) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise RaucaError(f"{option} {text}: not a comma separated list of numbers") from None


def _detectors(
    names: Sequence[str], vehicles: Sequence[VehicleChoice], device: str
) -> Mapping[str, Sequence[Detector]]:
    """The detectors that each category of vehicle is shown to, each loaded once.

    Named detectors must know every category; of ``all`` those are left out that do not, and the user is told.
    """
    from rauca_core.detect import find_class, load_detector
    from rauca_core.detect.weights import ready_names
    from rauca_core.study.measure import check_detectors

    named = [name for name in names if name != ALL]
    ready = [name for name in ready_names() if name not in named] if ALL in names or not names else []
    if not named and not ready:
        raise RaucaError("--detectors: none is ready; get weights with `rauca weights fetch --all`")
    loaded = {name: load_detector(name, device=device) for name in dict.fromkeys([*named, *ready])}
    result = {}
    for category in dict.fromkeys(vehicle.category for vehicle in vehicles):
        blind = [name for name in ready if find_class(loaded[name].class_names, category) is None]
        for name in blind:
            console.print(f"{name}: knows no class {category!r}, left out there", highlight=False)
        result[category] = [detector for name, detector in loaded.items() if name not in blind]
        check_detectors(result[category], category)
    return result


def _print(entries: Sequence[Entry], out: Path) -> None:
    """AP of every entry, a table each."""
    wide = output()
    for entry in entries:
        table = entry.results.table
        title = f"{entry.vehicle}, {entry.weathers}, defence {entry.defence}: AP@0.5 of class {entry.category}"
        shown = Table("paint", *next(iter(table.values())), title=title)
        for paint, row in table.items():
            shown.add_row(paint, *(f"{e.ap:.3f} [{e.low:.2f}, {e.high:.2f}]" for e in row.values()))
        wide.print(shown)
    clusters = {f"{e.results.cluster_count} {e.results.clusters}" for e in entries}
    wide.print(f"in brackets: 95 % interval by a bootstrap over {', '.join(sorted(clusters))}")
    console.print(f"study: {out}", highlight=False, soft_wrap=True)
