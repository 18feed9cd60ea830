"""``rauca dataset check``: is a data set whole, and does it mean what it says?"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..contract import (
    Dataset,
    PlannedFrame,
    Progress,
    RaucaError,
    Vehicle,
    frame_states,
    load_vehicle,
    planned_frames,
    read_ledger,
)
from ..contract.dataset import MAX_LEDGER_BYTES, LedgerEntry
from ..contract.files import TEMPORARY_PREFIX, disk_errors
from ..contract.reading import parse_json, read_limited
from ..contract.schema import Fields
from ..runtime.images import read_image
from .check_frame import MAKE_AGAIN, RENDER_AGAIN, Finding, FrameResult, check_frame, checksums

MIN_PSNR_DB = 30.0
"""Recoloring checks below this fail a weather: 40 dB is usual at 8 samples, at 30 the eye sees the difference."""

COUNTED = ("planned", "done", "occluded", "quarantined", "missing")


@dataclass
class WeatherResult:
    """One weather's frames.

    Attributes:
        counts: of frames by state.
        squared_error, values: of all its recoloring checks.
        checked: frames with a recoloring check.
    """

    counts: Counter[str] = field(default_factory=Counter)
    squared_error: float = 0.0
    values: int = 0
    checked: int = 0

    @property
    def psnr_db(self) -> float | None:
        """Predicted against rendered colors on the paint, display space; None without a check."""
        if not self.values:
            return None
        return -10 * math.log10(max(self.squared_error / self.values, 1e-12))


@dataclass
class CheckResult:
    """The whole examination.

    Attributes:
        findings: what is wrong, by frame in plan order.
        weathers: by name, in plan order.
    """

    findings: list[Finding]
    weathers: dict[str, WeatherResult]

    def to_json(self) -> dict[str, Any]:
        return {
            "findings": [{"file": f.file, "what": f.what, "remedy": f.remedy} for f in self.findings],
            "weathers": {
                name: {state: w.counts[state] for state in COUNTED}
                | {"checked": w.checked, "recolor_psnr_db": w.psnr_db}
                for name, w in self.weathers.items()
            },
        }


def check_dataset(
    folder: Path,
    min_psnr_db: float = MIN_PSNR_DB,
    unfinished: bool = False,
    progress: Callable[[Progress], None] = lambda _: None,
) -> CheckResult:
    """Read every file of a data set and hold them against each other, the plan and the ledger.

    Args:
        min_psnr_db: a weather whose recoloring checks fall below is a finding.
        unfinished: frames not rendered yet are no finding.

    Raises:
        RaucaError: ``folder`` is not a data set, or its plan cannot be read.
    """
    dataset = Dataset(folder)
    findings = list(_top_level(dataset))
    vehicle = _vehicle(dataset, findings)
    planned = planned_frames(dataset.plan)
    states = frame_states(folder)
    begun = dataset.begun()
    present = [frame for frame in planned if frame.id in begun and dataset.frame_folder(frame.id).is_dir()]
    weathers = {weather.name: WeatherResult() for weather in dataset.plan.weathers}
    for frame, result in _examined(dataset, present, vehicle, progress):
        findings += result.findings
        weather = weathers[frame.weather.name]
        weather.squared_error += result.squared_error
        weather.values += result.values
        weather.checked += result.values > 0
    for frame in planned:
        state = states.get(frame.id, "missing")
        weathers[frame.weather.name].counts.update(("planned", state if state in COUNTED else "missing"))
    findings += check_ledgers(folder, {frame.id for frame in planned}, {frame.id for frame in present})
    findings += _left_out(dataset, weathers, unfinished)
    findings += _poor_recoloring(weathers, min_psnr_db)
    return CheckResult(findings, weathers)


def remove_damaged(folder: Path, result: CheckResult) -> list[str]:
    """Remove the frames, and the vehicle, that findings are about; the same `rauca dataset make` makes them again.

    Returns:
        The folders removed, below the data set's.
    """
    removed = sorted({finding.again for finding in result.findings if finding.again})
    for name in removed:
        with disk_errors(folder / name), contextlib.suppress(FileNotFoundError):
            shutil.rmtree(folder / name)
    return removed


def _examined(
    dataset: Dataset, frames: list[PlannedFrame], vehicle: Vehicle | None, progress: Callable[[Progress], None]
) -> Iterator[tuple[PlannedFrame, FrameResult]]:
    """Every frame with its result, in order; several at a time, as hashing and inflating let other threads run."""
    progress(Progress(0, len(frames), ""))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = pool.map(lambda frame: check_frame(dataset, frame, vehicle), frames)
        for done, (frame, result) in enumerate(zip(frames, results, strict=True), 1):
            progress(Progress(done, len(frames), frame.id))
            yield frame, result


def _top_level(dataset: Dataset) -> Iterator[Finding]:
    """Plan and vehicle are the bytes that were written; nothing lies about that does not belong."""
    found: list[Finding] = []

    def report(file: str, what: str) -> None:
        """The plan says what everything is and cannot be made again beside it; the vehicle is written once more."""
        remedy = (RENDER_AGAIN, "vehicle") if file.startswith("vehicle/") else (MAKE_AGAIN, "")
        found.append(Finding(file, what, *remedy))

    checksums(
        report, dataset.folder, {"dataset.json", *(f"vehicle/{p.name}" for p in dataset.vehicle_folder.glob("*"))}
    )
    yield from found
    left = [path.name for path in dataset.folder.glob(f"{TEMPORARY_PREFIX}*")]
    left += [f"frames/{name}" for name in dataset.begun() if name.startswith(TEMPORARY_PREFIX)]
    for name in sorted(left):
        yield Finding(name, "left by a killed job", "run the same `rauca dataset make` again")
    known = {frame.id for frame in dataset.plan.frames()}
    for name in sorted(dataset.begun()):
        if name not in known and not name.startswith(TEMPORARY_PREFIX):
            yield Finding(f"frames/{name}", "is no frame of the plan", "remove it")


def _vehicle(dataset: Dataset, findings: list[Finding]) -> Vehicle | None:
    """The data set's vehicle, or None and a finding."""
    try:
        vehicle = load_vehicle(dataset.vehicle_folder, read_image)
    except RaucaError as error:
        told = str(error).removeprefix(f"{dataset.vehicle_folder}/")
        findings.append(Finding("vehicle", told, RENDER_AGAIN, again="vehicle"))
        return None
    if vehicle.atlas_id != dataset.plan.atlas_id:
        findings.append(Finding("vehicle", "its UV atlas is not the one the plan was made with", MAKE_AGAIN))
    return vehicle


def _left_out(dataset: Dataset, weathers: dict[str, WeatherResult], unfinished: bool) -> Iterator[Finding]:
    for entry in read_ledger(dataset.folder).values():
        if entry.state == "quarantined":
            again = "run the same `rauca dataset make` with --retry-quarantined"
            yield Finding(f"frames/{entry.frame}", f"failed twice: {entry.reason or 'no reason given'}", again)
    missing = sum(weather.counts["missing"] for weather in weathers.values())
    if missing and not unfinished:
        planned = sum(weather.counts["planned"] for weather in weathers.values())
        again = "run the same `rauca dataset make` to go on, or check with --unfinished"
        yield Finding("frames", f"{missing} of {planned} frames are not rendered", again)


def _poor_recoloring(weathers: dict[str, WeatherResult], min_psnr_db: float) -> Iterator[Finding]:
    for name, weather in weathers.items():
        psnr = weather.psnr_db
        if psnr is not None and psnr < min_psnr_db:
            what = f"recolored frames are {psnr:.1f} dB from rendered ones in weather {name}, below {min_psnr_db:g}"
            yield Finding("frames", what, "make the data set again with more --samples")


DROP_LINE = "remove the line; frames in folders are not affected"
GO_ON = "run the same `rauca dataset make` to render it again"


def check_ledgers(folder: Path, planned: Collection[str], present: Collection[str]) -> Iterator[Finding]:
    """Every line is whole, known and true.

    Args:
        planned: ids of all frames of the plan.
        present: ids of the frames that have a folder.
    """
    for path in sorted(Path(folder).glob("ledger*.jsonl")):
        yield from _lines(path, planned)
    try:
        entries = read_ledger(folder)
    except (RaucaError, UnicodeDecodeError):
        return  # the lines told
    for frame, entry in entries.items():
        if entry.state == "done" and frame in planned and frame not in present:
            yield Finding(f"frames/{frame}", "the ledger says done, its folder is gone", GO_ON)
        if entry.state == "occluded" and frame in present:
            yield Finding(f"frames/{frame}", "the ledger says occluded, yet its folder is there", "remove the folder")


def _lines(path: Path, planned: Collection[str]) -> Iterator[Finding]:
    *lines, rest = read_limited(path, MAX_LEDGER_BYTES, "a ledger").split(b"\n")
    if rest:
        yield Finding(path.name, "its last line is cut off", "run the same `rauca dataset make` again")
    for number, line in enumerate(lines, 1):
        try:
            frame = LedgerEntry.from_json(Fields(parse_json(line, "ledger"), "ledger")).frame
        except RaucaError as error:
            told = str(error).removeprefix("ledger: ")
            yield Finding(path.name, f"line {number} is damaged ({told})", DROP_LINE)
            continue
        if frame not in planned:
            yield Finding(path.name, f"line {number} names {frame!r}, which is no frame of the plan", DROP_LINE)
