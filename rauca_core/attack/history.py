"""What a run tells while it goes on: a line of JSON per step, tensorboard, and two pictures that any viewer shows."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..contract import RaucaError
from ..contract.color import to_bytes
from ..contract.files import append_line, png_bytes, write_bytes
from ..contract.reading import parse_json, read_limited
from ..runtime.board import Board

STAGES = ("load", "taps", "environment", "augmentation", "detector", "backward", "adam")


class Stopwatch:
    """Seconds by stage; what is in no stage is in none."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)

    @contextlib.contextmanager
    def time(self, stage: str) -> Iterator[None]:
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - begin


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
        stages: seconds by stage; ``detector`` is the detectors and their gradient.
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


class History:
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


SIDE = 512  # pixels, at most for the UV map
SHARE = 0.02  # of the run's time that pictures may take: it is waited so much longer than the last ones took
PICTURE, UV_MAP = "preview.png", "preview-uv-map.png"


class Preview:
    """Replaces ``preview.png`` (the UV map, and a frame in the paint beside it) and ``preview-uv-map.png``.

    Both are replaced whole: a reader never meets half a picture.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._next_s = folder, 0.0

    @property
    def due(self) -> bool:
        """Whether the pictures may be renewed without slowing the run."""
        return time.monotonic() >= self._next_s

    def show(self, uv_map_srgb: Tensor, image_srgb: Tensor) -> None:
        """Show a UV map (3, size, size) and a rendered frame (3, H, W)."""
        begin = time.monotonic()
        small = shrunk(uv_map_srgb, SIDE)
        frame = functional.interpolate(image_srgb[None].float().cpu(), size=small.shape[1:], mode="bilinear")[0]
        write_bytes(self._folder / UV_MAP, png_bytes(_pixels(small)))
        write_bytes(self._folder / PICTURE, png_bytes(_pixels(torch.cat([small, frame], 2))))
        end = time.monotonic()
        self._next_s = end + (end - begin) * (1 / SHARE - 1)


def shrunk(uv_map_srgb: Tensor, side: int) -> Tensor:
    """A UV map (3, size, size) of ``side`` texels at most, by the mean of its sRGB values: to look at only."""
    return functional.adaptive_avg_pool2d(uv_map_srgb.cpu(), min(side, uv_map_srgb.shape[-1])).clamp(0, 1)


def _pixels(image: Tensor) -> NDArray[np.uint8]:
    return to_bytes(image.clamp(0, 1).permute(1, 2, 0).numpy())
