"""What became of each frame: ``ledger.jsonl``, and ``ledger-<i>of<n>.jsonl`` of each shard, appended line by line.

A frame's folder is the proof that it is done; the ledger adds why a frame is missing and how long one took.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from .errors import RaucaError
from .files import append_line
from .json_lines import whole_lines
from .schema import Fields

MAX_LEDGER_BYTES = 2**28
"""A line is some 100 bytes; the largest plan, tried twice, makes 200 MB."""
STATES = ("done", "occluded", "failed", "quarantined")


@dataclass(frozen=True)
class LedgerEntry:
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
    state: str
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
        entries = whole_lines(path, MAX_LEDGER_BYTES, "a ledger", entry_of)
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


def entry_of(line: Fields) -> LedgerEntry:
    """What a line of a ledger says; raises :class:`RaucaError` where a field is missing or of another kind."""
    state = line.text("state")
    if state not in STATES:
        raise RaucaError(f"{line.where}: state must be one of {', '.join(STATES)}, not {state!r}")
    return LedgerEntry(
        line.text("frame"),
        state,
        seconds=line.number("seconds") if line.has("seconds") else None,
        visible=line.number("visible") if line.has("visible") else None,
        reason=line.text("reason") if line.has("reason") else None,
    )
