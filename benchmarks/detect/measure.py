"""Difference and speed of one contender."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import cv2
import torch
from torch import Tensor

from .contender import Contender
from .images import squared
from .results import Adapter

WARM_UPS = 2


def one_core() -> None:
    """The other cores may be busy, and a race of thread pools says little about networks."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)


def measure(contender: Contender, images: list[Tensor], timed: int) -> Adapter:
    """Compare on all images; race on the first ``timed``, turn by turn, so that the machine's moods hit both."""
    fitted = [squared(image, contender.size) for image in images]
    difference = max(contender.differences(image) for image in fitted)
    times: list[tuple[float, float, float]] = []
    for index in range(WARM_UPS + timed):
        image = fitted[index % len(fitted)]
        prepared = contender.prepare(image)
        times.append(
            (
                _milliseconds(contender.run, prepared),
                _milliseconds(contender.forward, image),
                _milliseconds(contender.backward, image),
            )
        )
    kept = times[WARM_UPS:]
    reference_ms, forward_ms, backward_ms = (statistics.median(column) for column in zip(*kept, strict=True))
    return Adapter(
        contender.name,
        difference,
        forward_ms,
        backward_ms,
        contender.reference,
        reference_ms,
        statistics.median(ours / theirs for theirs, ours, _ in kept),
        "detections" if contender.final else "predictions",
        len(images),
    )


def _milliseconds(work: Callable[[Any], Any], argument: Any) -> float:
    """CPU time: on one core it is the wall time of an idle machine."""
    start = time.process_time()
    work(argument)
    return 1e3 * (time.process_time() - start)
