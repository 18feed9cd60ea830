"""What an optimization and an evaluation take of time and disk before they begin, and how a guess becomes a measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core import contract, files, schema
from ..folders import own_folder, size_words
from .cameras.timing import frame_seconds

FILE = "step-pace.json"
IMAGE_S = 0.1  # of an image in a small detector there and back, on two cores (docs/speed.md)
START_S = 15.0  # of the other program, until its first step or frame: torch is loaded, a town is built
FEWEST = 5  # steps that make a measurement; the first ones build what later ones reuse
SEEN_S = 0.05  # of an image in a small detector, there alone
AGAIN = 0.47  # of a frame's time: the same view in another paint (docs/speed.md)
TAPS_S = 0.3  # of a view at 320 x 320 pixels, before the first step that needs it
# Bytes on disk at 320 x 320 pixels, as `rauca assess` estimates them: a view, the same in another paint, one with light
# maps, and what an optimization keeps of it.
VIEW_BYTES, AGAIN_BYTES, LIT_BYTES, TAPS_BYTES = 260_000, 170_000, 800_000, 2_200_000
# Of the camouflage's texels: itself, its pictures, and three arrays of floats in each of two checkpoints.
TEXEL_BYTES = 3 + 3 + 2 * 3 * 3 * 4

_kept: dict[str, float] = {}  # seconds of an image by the detectors it is shown to; read once
_read: list[bool] = []


def image_seconds(detectors: Sequence[str]) -> float:
    """Of one image of a step: measured with these detectors on this machine, or a guess."""
    if not _read:
        _read.append(True)
        _kept.update(recall(own_folder()))
    return _kept.get(_key(detectors), IMAGE_S * max(len(detectors), 1))


def recall(folder: Path) -> dict[str, float]:
    """What was measured before; nothing if that cannot be read."""
    try:
        kept = schema.read_json(folder / FILE)
        return {name: kept.number(name, 1e-6, 1e6) for name in kept.names()}
    except contract.RaucaError:
        return {}


def learn(detectors: Sequence[str], batch: int, seconds: Sequence[float]) -> None:
    """Keep how long steps took, ``seconds`` each, of ``batch`` images; too few change nothing."""
    if len(seconds) >= FEWEST:
        image_seconds(detectors)
        _kept[_key(detectors)] = sorted(seconds)[len(seconds) // 2] / batch
        files.write_json(own_folder() / FILE, _kept)


def of_optimization(steps: int, batch: int, detectors: Sequence[str], views: int, size: int, texels: int) -> Cost:
    """What optimizing takes.

    Args:
        steps: that are still to be done.
        views: cameras of the dataset, of ``size`` pixels.
        texels: side of the camouflage.
    """
    larger = (size / 320) ** 2
    seconds = START_S + steps * batch * image_seconds(detectors) + views * TAPS_S * larger
    return Cost(seconds, views * TAPS_BYTES * larger + texels**2 * TEXEL_BYTES)


def of_evaluation(
    views: int, paints: int, detectors: Sequence[str], size: int, steps: int = 0, lit_views: int = 0
) -> Cost:
    """What judging takes: views rendered in several paints and shown to detectors, and attacks on each of these.

    Args:
        paints: that each view is seen in.
        steps: of four images, of an attack on each detector, on ``lit_views`` views.
    """
    larger, frame, again, attacked = (size / 320) ** 2, frame_seconds(size), views * (paints - 1), len(detectors)
    seconds = START_S + frame * (views + AGAIN * again) + views * paints * SEEN_S * attacked
    size_bytes = views * VIEW_BYTES + again * AGAIN_BYTES
    if steps:
        seconds += sum(steps * 4 * image_seconds([name]) for name in detectors) + lit_views * (1.3 * frame + TAPS_S)
        size_bytes += lit_views * (LIT_BYTES + TAPS_BYTES)
    return Cost(seconds, size_bytes * larger)


@dataclass(frozen=True)
class Cost:
    """Seconds, and bytes on the disk."""

    seconds: float
    size_bytes: float

    def told(self) -> dict[str, str]:
        """Its ``time`` and ``disk`` in words, for a sentence."""
        return {"time": contract.format_duration(self.seconds), "disk": size_words(self.size_bytes)}


def _key(detectors: Sequence[str]) -> str:
    return " ".join(sorted(detectors))


def unregister() -> None:
    _kept.clear()
    _read.clear()
