"""``rauca evaluate`` and ``rauca report``: from what the user types to a study, its tables and its page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import rauca_core as rauca
from rauca_core.contract import RaucaError
from rauca_core.contract.clips import clips_asked

from .clip_options import ClipFrames, ClipNames, FrameRate, Readout, Shutter, Speed, Tracker, show_drives, write_drives
from .console import command_line, console, output
from .options import Blender, Device, JsonProgress, RenderDevice, Slurm, means_of, numbers, split_names
from .tables import print_table

if TYPE_CHECKING:
    from rauca_core.study.study import Study

view_option = partial(typer.Option, rich_help_panel="The held-out views")
Given = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[DATASET|CAMOUFLAGE]...", help="views to evaluate on instead of new ones; more camouflages"
    ),
]
Camouflages = Annotated[
    list[str] | None, typer.Option(help="camouflage .json, or LABEL=FILE; several, comma separated or repeated")
]
Out = Annotated[Path, typer.Option(help="folder of the study; run again to go on")]
Detectors = Annotated[
    list[str] | None, typer.Option("--detectors", "--detector", help="names or paths, comma separated; or all")
]
Weathers = Annotated[list[str] | None, typer.Option(help="seen, unseen, both, or a preset's name or .json file")]
Defences = Annotated[
    list[str] | None,
    typer.Option("--defences", "--defence", help="none, lgs, pad, jpeg, bits, median, nutnet; comma separated"),
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
    scale: Annotated[
        Literal["quick", "standard", "full"], view_option(help="32, 128 or 1024 frames per weather set")
    ] = "standard",
    frames: Annotated[int | None, view_option(min=1, help="frames per weather set, instead of a scale")] = None,
    ring: Annotated[
        Literal["street", "paper"], view_option(help="0 to 24 degrees up, 5 to 16 m away; or 0 to 67.5, 5 to 20 m")
    ] = "street",
    elevations: Annotated[str | None, view_option(help="of the cameras, degrees; the ring's by default")] = None,
    distances: Annotated[
        str | None,
        view_option(help="of the cameras, metres; the ring's by default, farther for large vehicles"),
    ] = None,
    fov: Annotated[
        float, view_option(min=1, max=170, help="horizontal field of view, degrees; the paper's is 90")
    ] = 60.0,
    locations: Annotated[int, view_option(min=1, help="places in the held-out town")] = 8,
    size: Annotated[int, view_option(min=16, help="frames are square, pixels")] = 320,
    samples: Annotated[int, view_option(min=1, help="Cycles samples per pixel before denoising")] = 8,
    views_seed: Annotated[int | None, view_option(min=0, help="of the held-out town and its cameras")] = None,
    clips: ClipNames = None,
    clip_frames: ClipFrames = 30,
    speed: Speed = 10.0,
    frame_rate: FrameRate = 15.0,
    shutter: Shutter = 0.0,
    readout: Readout = 0.0,
    tracker: Tracker = "bytetrack",
    random: Annotated[bool, typer.Option("--random", help="evaluate in random paint too")] = False,
    random_seed: Annotated[int, typer.Option(min=0, help="of the random paint")] = 1,
    random_cell: Annotated[int, typer.Option(min=1, help="side of a cell of random paint, texels of 1024")] = 8,
    device: Device = "cpu",
    scene: Annotated[Path | None, view_option(help="the .blend that DATASET was made in, if it was")] = None,
    store: Annotated[
        Path | None,
        typer.Option(help="keep views, renders and detections here, for other studies; OUT/store if left out"),
    ] = None,
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
    json_progress: JsonProgress = False,
) -> None:
    """Measure AP@0.5 on held-out views: reference paint, camouflages, defences; re-rendered by Cycles."""
    from rauca_core.contract.towns import TEST
    from rauca_core.study.driven import has_clips
    from rauca_core.study.evaluate import RandomPaint
    from rauca_core.study.views import RINGS, SCALES, HeldOut

    files = [path for path in given or () if path.suffix in (".json", ".png")]
    datasets = [path for path in given or () if path not in files]
    if datasets and weathers:
        raise RaucaError("--weathers: a data set brings its own weathers; drop one of the two")
    chosen = replace(
        RINGS[ring],
        elevations_deg=numbers("--elevations", elevations or "") or RINGS[ring].elevations_deg,
        distances_m=numbers("--distances", distances or "") or RINGS[ring].distances_m,
        fov_deg=fov,
    )
    town = TEST["held-out views"] if views_seed is None else views_seed
    views = HeldOut(frames or SCALES[scale], chosen, locations, size, samples, town, fit=distances is None)
    if clips:
        driven = clips_asked(clips, clip_frames, speed, frame_rate, shutter, readout)
        views = HeldOut.driven(driven, size, samples, views_seed)
    with means_of(device, slurm, blender, render_device, json_progress=json_progress) as means:
        study = rauca.evaluate(
            [*split_names(camouflage), *files], split_names(detectors), out=out, vehicle=split_names(vehicle),
            weathers=split_names(weathers) or ["both"], views=views, datasets=datasets,
            defences=split_defences(defences), random=RandomPaint(random_seed, random_cell) if random else None,
            scene=scene, store=store, command=command_line(), **means,
        )  # fmt: skip
    _print(study, out)
    if has_clips(study):
        show_drives(write_drives(study, out, tracker))


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="folder of a study, such as the demo's")],
    latex: Annotated[bool, typer.Option("--latex", help="write the tables as LaTeX too, to STUDY/report.tex")] = False,
    pictures: Annotated[Path | None, typer.Option(help="save the main figures to this folder too")] = None,
) -> None:
    """Write STUDY/report.html, and its numbers as report.csv and report.json, from what STUDY holds."""
    from rauca_core.report import save_showcase

    found = rauca.Study.load(study)
    console.print(f"report: {found.report(study / 'report.html', latex)}")
    for path in save_showcase(found, pictures) if pictures else ():
        console.print(f"picture: {path}")


def split_defences(given: Sequence[str] | None) -> list[str]:
    """Defences, comma separated, whose parameters have commas too: ``none,lgs:block=9,overlap=3`` are two."""
    names: list[str] = []
    for part in split_names(given):
        if names and ":" in names[-1] and "=" in part and ":" not in part:
            names[-1] += f",{part}"
        else:
            names.append(part)
    return names


def _print(study: Study, out: Path) -> None:
    """The tables of the study's page."""
    from rauca_core.report.study_tables import tables_of

    for table in tables_of(study):
        print_table(table)
    places = {entry.results.places for entry in study.entries}
    output().print(f"in brackets: 95 % interval over {', '.join(sorted(places))}")
    console.print(f"study: {out}", highlight=False, soft_wrap=True)
