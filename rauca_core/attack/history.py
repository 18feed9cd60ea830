"""What a run leaves in its folder: a line of JSON per step, tensorboard, two pictures, checkpoints."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from ..contract import RaucaError
from ..contract.color import to_bytes
from ..contract.files import append_line, png_bytes, sweep_partials, write_bytes
from ..contract.reading import parse_json, read_limited
from ..contract.schema import Fields, Record
from ..runtime.board import Board
from ..runtime.tensor_files import CHECKPOINTS, Checkpoint, save_checkpoint

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
class StepReport(Record):
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
            reports.append(asdict(StepReport.from_json(Fields(parse_json(line, HISTORY), HISTORY))))
        except RaucaError as error:
            if number < len(lines):
                raise RaucaError(f"{path}: line {number} is damaged; remove it") from error
    return reports


SIDE = 512  # pixels, at most for the UV map
SHARE = 0.02  # of the run's time that pictures may take: it is waited so much longer than the last ones took
PICTURE, UV_MAP = "preview.png", "preview-uv-map.png"


class Recorder:
    """What a run leaves in its folder while it goes on: history, tensorboard, two pictures, checkpoints.

    The history is written in blocks, so that it never runs ahead of the checkpoint it belongs to. ``preview.png`` (the
    UV map, and a frame in the paint beside it) and ``preview-uv-map.png`` are replaced whole.
    """

    def __init__(self, out: Path, step: int) -> None:
        """Open a run's record after ``step`` steps; what a killed run wrote beyond is dropped."""
        sweep_partials(out)
        self._out, self._history, self._next_s = out, out / HISTORY, 0.0
        if self._history.is_file():
            kept = [json.dumps(line) + "\n" for line in read_history(out) if line["step"] <= step]
            write_bytes(self._history, "".join(kept).encode())
        self._pending: list[str] = []
        self._board = Board(out / "tensorboard", step + 1)

    def add(self, report: StepReport, pictures: Callable[[], tuple[Tensor, Tensor]]) -> None:
        """Note a step; ``pictures`` makes the UV map (3, size, size) and a frame (3, H, W), if it is time for them."""
        self._pending.append(json.dumps(asdict(report)))
        self._board.scalars({name: getattr(report, name) for name in CURVES}, report.step)
        if time.monotonic() >= self._next_s:
            self._preview(*pictures())

    def save(self, checkpoint: Checkpoint, uv_map_srgb: Tensor, image_srgb: Tensor) -> None:
        """Bring what is on disk up to a step."""
        self._board.picture("uv_map", self._preview(uv_map_srgb, image_srgb), checkpoint.step)
        self._board.picture("frame", image_srgb.clamp(0, 1).cpu(), checkpoint.step)
        if self._pending:  # first: a resumed run cuts the history to its checkpoint, never extends it
            append_line(self._history, "\n".join(self._pending))
            self._pending = []
        self._board.flush()
        save_checkpoint(self._out / CHECKPOINTS, checkpoint)

    def close(self) -> None:
        self._board.close()

    def _preview(self, uv_map_srgb: Tensor, image_srgb: Tensor) -> Tensor:
        """Write both pictures; returns the UV map as shown, averaged in sRGB values: to look at only."""
        begin = time.monotonic()
        small = functional.adaptive_avg_pool2d(uv_map_srgb.cpu(), min(SIDE, uv_map_srgb.shape[-1])).clamp(0, 1)
        frame = functional.interpolate(image_srgb[None].float().cpu(), size=small.shape[1:], mode="bilinear")[0]
        for name, picture in ((UV_MAP, small), (PICTURE, torch.cat([small, frame], 2))):
            write_bytes(self._out / name, png_bytes(to_bytes(picture.clamp(0, 1).permute(1, 2, 0).numpy())))
        end = time.monotonic()
        self._next_s = end + (end - begin) * (1 / SHARE - 1)
        return small
