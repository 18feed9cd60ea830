"""A data set on disk: a vehicle, a plan, and the frames rendered so far.

Folder layout::

    dataset.json       the plan: everything needed to render any frame again
    vehicle/           see `vehicle.py`
    frames/<id>/       see `frame.py`
    ledger.jsonl       one line per frame, appended after the frame's rename; ``ledger-<i>of<n>.jsonl`` of each shard

A frame's folder is the proof that it is done; the ledger adds why a frame is missing and how long one took.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from .errors import RaucaError
from .files import append_line
from .frame import Frame, load_frame
from .plan import read_plan
from .schema import Record, whole_lines

MAX_LEDGER_BYTES = 2**28
"""A line is some 100 bytes; the largest plan, tried twice, makes 200 MB."""
STATES = ("done", "occluded", "failed", "quarantined")


class Dataset:
    """A data set folder opened for reading: its plan and its finished frames."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.plan = read_plan(self.folder)

    @property
    def vehicle_folder(self) -> Path:
        return self.folder / "vehicle"

    def frame_folder(self, frame_id: str) -> Path:
        return frame_folder(self.folder, frame_id)

    def frames(self) -> list[Frame]:
        """Finished frames in plan order; frames kept out as occluded have no folder and do not appear."""
        there = self.begun()
        planned = (self.frame_folder(frame.id) for frame in self.plan.frames() if frame.id in there)
        return [load_frame(folder) for folder in planned if (folder / "frame.json").is_file()]

    def require_rendered(self, purpose: str) -> None:
        """Raise :class:`RaucaError` for a data set with composed frames; ``purpose`` says what wants rendered ones."""
        composed = next((frame for frame in self.frames() if frame.composed), None)
        if composed is not None:
            what = "is a picture whose light is estimated" if composed.pictured else "was composed from other frames"
            raise RaucaError(
                f"{self.folder}: frame {composed.id} {what}, to learn from; {purpose} rendered ones alone: give a data "
                "set of `rauca dataset make`"
            )

    def require_rendered_or_pictured(self, purpose: str) -> bool:
        """Raise :class:`RaucaError` for frames composed from others, and for pictures among rendered frames.

        Args:
            purpose: says what wants them.

        Returns:
            Whether the frames are pictures: what is shown of them in other paint is composed, never rendered.
        """
        pictured = [frame.pictured for frame in self.frames()]
        if not any(pictured):
            self.require_rendered(purpose)
        elif not all(pictured):
            raise RaucaError(f"{self.folder}: holds pictures among rendered frames; give each a data set of its own")
        return any(pictured)

    def begun(self) -> frozenset[str]:
        """Names of all there is among the frames: one look, where a plan may have thousands that are not rendered."""
        frames = self.folder / "frames"
        return frozenset(os.listdir(frames)) if frames.is_dir() else frozenset()


def frame_folder(dataset: Path, frame_id: str) -> Path:
    return Path(dataset) / "frames" / frame_id


@dataclass(frozen=True)
class LedgerEntry(Record):
    """One line.

    Attributes:
        frame: its id.
        state: ``done``; ``occluded`` (kept out: too little of the paint is visible); ``failed`` (will be tried again);
            ``quarantined`` (failed twice: left out until asked for).
        seconds: it took to render; None if unknown.
        visible: share of the paint that is visible, of occluded frames.
        reason: of failed and quarantined frames.
    """

    frame: str
    state: Annotated[str, STATES]
    seconds: float | None = None
    visible: float | None = None
    reason: str | None = None


def append_entry(folder: Path, entry: LedgerEntry, shard: str = "") -> None:
    """Append to the ledger of a data set ``folder``, or of its shard labeled ``shard``; one writer per file."""
    name = f"ledger-{shard}.jsonl" if shard else "ledger.jsonl"
    known = {key: value for key, value in asdict(entry).items() if value is not None}
    append_line(Path(folder) / name, json.dumps(known))


def read_ledger(folder: Path) -> dict[str, LedgerEntry]:
    """The last word of all ledgers of a data set on each frame.

    Within a file the last line counts; between files ``occluded`` and ``done`` outweigh what failed elsewhere. Lines
    cut off by a crash are skipped.
    """
    result: dict[str, LedgerEntry] = {}
    for path in sorted(Path(folder).glob("ledger*.jsonl")):
        entries = whole_lines(path, MAX_LEDGER_BYTES, "a ledger", LedgerEntry.from_json)
        for frame, entry in {entry.frame: entry for entry in entries}.items():
            if frame not in result or STATES.index(entry.state) < STATES.index(result[frame].state):
                result[frame] = entry
    return result


def frame_states(folder: Path) -> dict[str, str]:
    """State of every frame that needs no work or was given up: ``done`` if its folder is whole, else the ledger's."""
    states = {entry.frame: entry.state for entry in read_ledger(folder).values() if entry.state != "done"}
    frames = Path(folder) / "frames"
    if frames.is_dir():
        states |= {found.name: "done" for found in frames.iterdir() if (found / "frame.json").is_file()}
    return states
