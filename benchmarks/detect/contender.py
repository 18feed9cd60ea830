"""An adapter of ours and the runtime its network comes from, made comparable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.detect import DensePredictions, Detections, Detector

# A runtime that leaves a score out, as OpenCV does for boxes it suppressed, has NaN there: nothing to compare with.
Rows = NDArray[np.float32]
ROUNDING = 1e-5  # of scores; random weights give many detections nearly the same


@dataclass(frozen=True)
class Contender:
    """One adapter.

    Attributes:
        name: of the detector.
        reference: the other runtime, with its version.
        size: images are stretched to this square before either sees them.
        detector: ours.
        final: final detections are compared, since the reference does not show what it had before suppression.
        prepare: an image (1, 3, size, size) to what the reference takes; not timed.
        run: the reference's part of the race.
        rows: what it found: (N, 4 + C) boxes as fractions of the image and scores per class, in our order; for
            ``final`` (M, 6) boxes, score, label, in any order.
        thresholds: of score and overlap, for ``final``.
        run_openly: in place of ``run`` where the difference is taken, for a reference that keeps low scores to itself.
    """

    name: str
    reference: str
    size: int
    detector: Detector
    prepare: Callable[[Tensor], Any]
    run: Callable[[Any], Any]
    rows: Callable[[Any], Rows]
    final: bool = False
    thresholds: tuple[float, float] = (0.0, 1.0)
    run_openly: Callable[[Any], Any] | None = None

    def forward(self, image: Tensor) -> DensePredictions | list[Detections]:
        """Our part of the race: the same work, without gradients."""
        if self.final:
            return self.detector.detect(image, *self.thresholds)
        with torch.inference_mode():
            return self.detector.dense(image)

    def backward(self, image: Tensor) -> None:
        """What an attack's step pays: predictions with gradients, and their way back to the image."""
        wanted = image.clone().requires_grad_()
        found = self.detector.dense(wanted)
        (found.objectness[..., None] * found.classes).amax((1, 2)).sum().backward()

    def differences(self, image: Tensor) -> float:
        """Largest difference of any score or box side (as a fraction of the image's)."""
        theirs = self.rows((self.run_openly or self.run)(self.prepare(image)))
        if self.final:
            found = self.detector.detect(image, *self.thresholds)[0]
            return unordered_difference(final_rows(found, self.size), theirs, self.thresholds[0])
        plain, with_gradient = (self.detector.dense(image.clone().requires_grad_(wants)) for wants in (False, True))
        return max(ordered_difference(dense_rows(found, self.size), theirs) for found in (plain, with_gradient))


def dense_rows(found: DensePredictions, size: int) -> Rows:
    """(N, 4 + C): boxes as fractions of the image, scores."""
    scores = found.objectness[0, :, None] * found.classes[0]
    return torch.cat([found.boxes[0] / size, scores], 1).detach().numpy()


def final_rows(found: Detections, size: int) -> Rows:
    """(M, 6): boxes as fractions of the image, score, label."""
    return torch.cat([found.boxes / size, found.scores[:, None], found.labels[:, None]], 1).numpy()


def ordered_difference(ours: Rows, theirs: Rows) -> float:
    """NaN counts as nothing said; shapes must be the same, or all is different."""
    if ours.shape != theirs.shape or np.isnan(theirs).all():
        return float("inf")
    return float(np.nanmax(np.abs(ours - theirs)))


def unordered_difference(ours: Rows, theirs: Rows, threshold: float = 0.0) -> float:
    """Each detection against the nearest of the same label, both ways: equal scores may come in any order.

    One whose score is the ``threshold`` but for rounding may be missing on either side.
    """
    sure, theirs_sure = (rows[:, 4] > threshold + ROUNDING for rows in (ours, theirs))
    if not 0 < sure.sum() <= len(theirs) or not 0 < theirs_sure.sum() <= len(ours):
        return float("inf")
    apart = np.abs(ours[:, None, :5] - theirs[None, :, :5]).max(2)
    apart[ours[:, None, 5] != theirs[None, :, 5]] = np.inf
    return float(max(apart.min(0)[theirs_sure].max(), apart.min(1)[sure].max()))
