"""The record of a run: a line of JSON per step, and tensorboard."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from torch import Tensor

from ..contract import RaucaError
from ..contract.files import append_line, write_bytes
from ..contract.reading import parse_json, read_limited
from ..runtime.board import Board
from .preview import SIDE, shrunk

HISTORY = "history.jsonl"
CURVES = ("loss", "attack", "smooth", "prior", "score")  # of a step, for tensorboard and the camouflage's record
MAX_HISTORY_BYTES = 2**28  # a line is some 400 bytes: half a million steps


@dataclass(frozen=True)
class StepReport:
    """One step, as told to callbacks and kept in the history.

    Attributes:
        step: counted from 1; ``steps`` in all.
        loss: Eq. 8; ``attack`` and ``smooth`` are the objective (Eq. 6, mean over the batch) and Eq. 7, unweighted.
        score: max H_d, mean over the batch.
        seconds: of the whole step.
        stages: seconds by stage, see `stopwatch`; ``detector`` is the detectors and their gradient.
        prior: the second loss on the paint, unweighted; 0 where there is none.
    """

    step: int
    steps: int
    loss: float
    attack: float
    smooth: float
    score: float
    seconds: float
    stages: dict[str, float]
    prior: float = 0.0


class Journal:
    """Writes history in blocks, so that it never runs ahead of the checkpoint it belongs to."""

    def __init__(self, folder: Path, step: int) -> None:
        """Open a run's record after ``step`` steps; what a killed run wrote beyond is dropped."""
        self._path = folder / HISTORY
        kept = [line for line in read_history(folder) if line["step"] <= step] if self._path.is_file() else []
        if self._path.is_file():
            write_bytes(self._path, "".join(json.dumps(line) + "\n" for line in kept).encode())
        self._pending: list[str] = []
        self._board = Board(folder / "tensorboard", step + 1)

    def add(self, report: StepReport) -> None:
        self._pending.append(json.dumps(asdict(report)))
        self._board.scalars({name: getattr(report, name) for name in CURVES}, report.step)

    def preview(self, step: int, uv_map_srgb: Tensor, image_srgb: Tensor) -> None:
        """Show a UV map (3, size, size) and a rendered frame (3, H, W)."""
        self._board.picture("uv_map", shrunk(uv_map_srgb, SIDE), step)
        self._board.picture("frame", image_srgb.clamp(0, 1).cpu(), step)

    def flush(self) -> None:
        if self._pending:
            append_line(self._path, "\n".join(self._pending))
            self._pending = []
        self._board.flush()

    def close(self) -> None:
        self._board.close()


def read_history(folder: Path) -> list[dict[str, float]]:
    """The reports of a run in ``folder``, one per step.

    Raises:
        RaucaError: missing or damaged; a torn last line, left by a crash, is dropped.
    """
    path = Path(folder) / HISTORY
    if not path.is_file():
        raise RaucaError(f"{path}: not found; optimize a camouflage first")
    lines, reports = read_limited(path, MAX_HISTORY_BYTES, "the history of a run").splitlines(), []
    for number, line in enumerate(lines, 1):
        try:
            reports.append(_report(line))
        except RaucaError as error:
            if number < len(lines):
                raise RaucaError(f"{path}: line {number} is damaged; remove it") from error
    return reports


def _report(line: bytes) -> dict[str, float]:
    report = parse_json(line, HISTORY)
    kinds = {"step": int, **dict.fromkeys(CURVES, float)}
    if not isinstance(report, dict) or any(type(report.get(name)) is not kind for name, kind in kinds.items()):
        raise RaucaError(f"{HISTORY}: no report of a step")
    return report
