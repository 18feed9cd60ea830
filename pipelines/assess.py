"""``rauca assess``: how robust a detector is, from one command to one headline, a page and an exit code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import rauca_core as rauca
from rauca_core.contract import RaucaError
from rauca_core.contract.clips import clips_asked

from .clip_options import (
    ClipFrames,
    ClipNames,
    FrameRate,
    Readout,
    Shutter,
    Speed,
    Tracker,
    clip_option,
    show_drives,
    write_drives,
)
from .console import command_line, console, output
from .detector_commands import Classes, ClassNames, open_detector, show_preflight
from .evaluate import split_defences
from .options import Blender, Device, JsonProgress, RenderDevice, Slurm, Threads, means_of, split_names

if TYPE_CHECKING:
    from rauca_core.detect import Detector
    from rauca_core.study.assessment import Assessment, Condition
    from rauca_core.study.cost import Work
    from rauca_core.study.preflight import Preflight

Conditions = Annotated[
    list[str] | None,
    typer.Option("--fail-below", help="exit with 1 if a figure is lower, such as transfer_ap=0.5; repeat for more"),
]


def assess(
    detectors: Annotated[list[str], typer.Argument(metavar="DETECTOR...", help="names or files; several are compared")],
    out: Annotated[Path, typer.Option(help="folder of the assessment; run again to go on")],
    classes: Classes = None,
    names: ClassNames = None,
    budget: Annotated[
        Literal["quick", "standard", "overnight"], typer.Option(help="how much of the battery, and of an attack")
    ] = "quick",
    battery: Annotated[str, typer.Option(help="frozen set of views and camouflages")] = "assess-4",
    vehicle: Annotated[list[str] | None, typer.Option(help="only these of the battery, comma separated")] = None,
    white_box: Annotated[
        bool, typer.Option("--white-box/--no-white-box", help="make a camouflage against the detector itself, too")
    ] = True,
    defences: Annotated[
        list[str] | None, typer.Option(help="to look through: lgs, pad, jpeg, bits, median, nutnet")
    ] = None,
    pictures: Annotated[
        list[Path] | None,
        typer.Option(help="data set of pictures to look at too, apart, in OUT/pictures; repeat for more"),
    ] = None,
    clips: ClipNames = None,
    clip_frames: ClipFrames = 30,
    clip_weathers: Annotated[list[str] | None, clip_option(help="of clips, as --weathers of `rauca evaluate`")] = None,
    speed: Speed = 10.0,
    frame_rate: FrameRate = 15.0,
    shutter: Shutter = 0.0,
    readout: Readout = 0.0,
    tracker: Tracker = "bytetrack",
    threshold: Annotated[float, typer.Option(min=0.0, max=1.0, help="score at which the detector is deployed")] = 0.25,
    harden: Annotated[bool, typer.Option("--harden", help="harden the detector, and assess it again")] = False,
    before: Annotated[Path | None, typer.Option(help="assess.json of an earlier one: say what changed")] = None,
    fail_below: Conditions = None,
    json: Annotated[Path | None, typer.Option("--json", help="write the assessment here, too")] = None,
    latex: Annotated[bool, typer.Option("--latex", help="write the tables as LaTeX, too")] = False,
    threads: Threads = None,
    device: Device = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
    json_progress: JsonProgress = False,
) -> None:
    """Say how robust a detector is: plain, random, camouflages made for others, and one made for it."""
    from rauca_core.report import write_comparison
    from rauca_core.study.assess import CLIPS, FILE_NAME, PICTURES, Driving, works_of
    from rauca_core.study.assessment import Condition, load_assessment, save_assessment
    from rauca_core.study.battery_hardening import harden_on_battery

    conditions = [Condition.parse(one) for one in fail_below or ()]
    if before is not None:
        load_assessment(before)
    folders = _folders(detectors, out)
    if json is not None and len(folders) > 1:
        raise RaucaError(f"--json {json}: is for one detector; with several, each has {FILE_NAME} in its own folder")
    looked_through, vehicles = split_defences(defences), split_names(vehicle)
    if slurm and (classes or names or looked_through):
        raise RaucaError("--slurm: its tasks load a detector by its name alone; drop --classes, --names and --defences")
    driving = None
    if clips:
        driven = clips_asked(clips, clip_frames, speed, frame_rate, shutter, readout)
        driving = Driving(driven, tuple(split_names(clip_weathers)) or ("single",), tracker)
    works = works_of(battery, vehicles, white_box, len(looked_through), driving)
    same: dict[str, Any] = {"battery": battery, "budget": budget, "vehicles": vehicles, "command": command_line()}
    asked = same | {
        "white_box": white_box, "defences": looked_through, "threshold": threshold, "pictures": pictures or [],
        "clips": driving,
    }  # fmt: skip
    found = []
    for name, folder in folders.items():
        detector = open_detector(name, classes, names, None, device)
        checked = _check(detector, works[budget], budget, device)
        with means_of(device, slurm, blender, render_device, threads, json_progress) as means:
            one = rauca.assess(name if slurm else detector, out=folder, checked=checked, **asked, **means)
            found.append(one.assessment)
            if driving:
                write_drives(rauca.Study.load(folder / CLIPS), folder / CLIPS, tracker)
            _tell(one.report(folder / "report.html", before, latex))
            if pictures:
                _tell(rauca.Study.load(folder / PICTURES).report(folder / PICTURES / "report.html", latex))
            if harden:
                weights = harden_on_battery(name, folder / "hardened", **same, **means)
                assessed = folder / "hardened" / "assessed"
                after = rauca.assess(weights, out=assessed, **asked, **means)
                if driving:
                    write_drives(rauca.Study.load(assessed / CLIPS), assessed / CLIPS, tracker)
                _tell(after.report(assessed / "report.html", folder / FILE_NAME, latex))
                console.print(f"hardened: {after.headline}", soft_wrap=True)
        if json is not None:
            save_assessment(json, one.assessment)
    if len(found) > 1:
        pages = [folder / "report.html" for folder in folders.values()]
        console.print(f"comparison: {write_comparison(found, out / 'report.html', pages)[0]}", soft_wrap=True)
    for assessment in found:
        output().print(assessment.headline, soft_wrap=True)
        if assessment.clips is not None:
            show_drives(assessment.clips)
    _stop_unless(conditions, found)


def _tell(page: Path) -> None:
    console.print(f"report: {page}", soft_wrap=True)


def _folders(detectors: Sequence[str], out: Path) -> dict[str, Path]:
    """Where each detector's assessment lies: in ``out`` itself if there is but one."""
    if len(detectors) == 1:
        return {detectors[0]: out}
    stems = [Path(name).stem for name in detectors]
    if len(set(stems)) < len(stems):
        raise RaucaError(f"two of {', '.join(detectors)} have one name; rename a file, or assess them one by one")
    return {name: out / stem for name, stem in zip(detectors, stems, strict=True)}


def _check(detector: Detector, work: Work, budget: str, device: str) -> Preflight:
    """Look at the detector for a minute, and say what hours of work would come to."""
    from rauca_core.study.preflight import preflight

    checked = preflight(detector, works={budget: work}, device=device)
    show_preflight(checked, console)
    return checked


def _stop_unless(conditions: Sequence[Condition], found: Sequence[Assessment]) -> None:
    """Exit with 1 and the reasons if a condition is not met."""
    failures = [f"{one.detector.name}: {why}" for one in found for c in conditions if (why := c.failure(one))]
    for failure in failures:
        console.print(f"failed: {failure}", style="red", soft_wrap=True)
    if failures:
        raise typer.Exit(1)
