"""What the chosen folders hold already, for panels: derived from the disk, which is asked twice a second at most."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import bpy

from ..core import contract, schema
from ..jobs import pictures

ASK_EVERY_S = 0.5
UNFINISHED = "unfinished.json"  # the camouflage of a stopped run, as `rauca optimize` names it
CHECKPOINT = Path("checkpoints") / "checkpoint.json"
T = TypeVar("T")


@dataclass(frozen=True)
class Frames:
    """Frames of a dataset's plan, and how many of them need no more work: rendered, or found to show too little.

    ``views`` counts cameras, at every location; frames are ``size`` pixels wide.
    """

    done: int
    planned: int
    views: int
    size: int


@dataclass(frozen=True)
class Paint:
    """A finished camouflage and the steps that it took; without a name, a run that was stopped after them."""

    name: str
    steps: int


@dataclass
class _Answer:
    asked_at: float
    stamps: tuple[int, ...]
    found: object


_answers: dict[tuple[str, str], _Answer] = {}


def chosen_path(setting: str) -> Path:
    """The folder of a setting; ``//`` stands for the .blend's."""
    return Path(bpy.path.abspath(setting)).absolute()


def folder_there(setting: str) -> bool:
    """Whether the chosen folder is there."""
    return ask("folder", setting, ("",), lambda folder: folder.is_dir()) or False


def frames_in(setting: str) -> Frames | None:
    """The dataset in the chosen folder; None where there is none that can be read."""
    return ask("frames", setting, ("dataset.json", "frames", "ledger.jsonl"), _frames)


def finished_frames(setting: str) -> list[contract.PlannedFrame]:
    """Of the dataset in the chosen folder, in the plan's order; empty where there is none that can be read."""
    return ask("finished", setting, ("dataset.json", "frames", "ledger.jsonl"), _finished) or []


def _finished(folder: Path) -> list[contract.PlannedFrame]:
    states = contract.frame_states(folder)
    return [frame for frame in contract.read_plan(folder).frames() if states.get(frame.id) == "done"]


def paint_in(setting: str) -> Paint | None:
    """The camouflage, or the stopped run, in the chosen folder; None where there is none that can be read."""
    return ask("paint", setting, ("camouflage.json", str(CHECKPOINT)), _paint)


def camouflage_at(setting: str) -> contract.Camouflage | None:
    """The camouflage in the chosen .json or .png file; None where there is none that can be read."""
    if not setting:
        return None
    path = chosen_path(setting).with_suffix(".json")
    return ask(
        f"camouflage {path.name}", str(path.parent), (path.name,), lambda folder: _camouflage(folder / path.name)
    )


def picture_of(setting: str) -> int:
    """The icon of the chosen camouflage, a small picture of its texture; 0 where there is none."""
    path = chosen_path(setting).with_suffix(".json")
    found = ask(f"picture {path.name}", str(path.parent), (path.name, f"{path.stem}.png"), lambda _: _picture(path))
    return pictures.load(*found) if found is not None else 0


def _camouflage(path: Path) -> contract.Camouflage:
    told: contract.Camouflage = contract.load_camouflage(path)[0]
    return told


def _picture(path: Path) -> tuple[str, Path]:
    """The name that a camouflage's picture is kept under, and its file; an older one is dropped."""
    name = f"camouflage.{path}"
    image = contract.load_camouflage(path)[1]
    pictures.forget(name)
    return name, image


def _frames(folder: Path) -> Frames:
    plan, states = contract.read_plan(folder), contract.frame_states(folder)
    planned = plan.frames()
    done = sum(states.get(frame.id) in ("done", "occluded") for frame in planned)
    return Frames(done, len(planned), len(plan.ring) * plan.locations, plan.size)


def _paint(folder: Path) -> Paint:
    if (folder / "camouflage.json").is_file():
        made, _ = contract.load_camouflage(folder / "camouflage.json")
        steps = made.made.get("steps", 0)
        return Paint(made.name, steps if isinstance(steps, int) else 0)
    return Paint("", schema.read_json(folder / CHECKPOINT).integer("step"))


def ask(kind: str, setting: str, names: tuple[str, ...], read: Callable[[Path], T | None]) -> T | None:
    """What ``read`` finds in the chosen folder; None where there is nothing that can be read.

    It is asked again only when one of the named entries of the folder has changed, and not at every redraw.
    """
    if not setting:
        return None
    folder, now = chosen_path(setting), time.monotonic()
    known = _answers.get((kind, str(folder)))
    if known is None or now - known.asked_at >= ASK_EVERY_S:
        stamps = tuple(_stamp(folder / name) for name in names)
        if known is None or known.stamps != stamps:
            known = _answers[kind, str(folder)] = _Answer(now, stamps, _read(read, folder))
        known.asked_at = now
    return known.found  # type: ignore[return-value]


def forget() -> None:
    """Ask the disk again at the next redraw: a job has just ended."""
    _answers.clear()


unregister = forget  # the pictures go with the jobs'


def _read(read: Callable[[Path], T | None], folder: Path) -> T | None:
    try:
        return read(folder)
    except (contract.RaucaError, OSError):
        return None


def _stamp(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
