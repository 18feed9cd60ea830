"""Final detections as a foreign program reports them, checked before they count."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..contract import RaucaError
from .classes import canonical
from .foreign import first_line
from .interface import Detections

PARTS = ("boxes", "scores", "labels")
ROUNDING = 1e-3  # of scores beyond [0, 1], and of corners in pixels


def read_answers(name: str, answers: Any, images: Tensor, class_names: Sequence[str]) -> list[Detections]:
    """What a detector answered to ``images`` (B, 3, H, W), best first, on their device; gradients flow.

    Args:
        name: the detector's, for messages.
        answers: a list of B: each a dict with ``boxes`` (M, 4) xyxy in pixels of the image, ``scores`` (M,) in [0, 1]
            and ``labels`` (M,), or a tuple of the three; of torch, of NumPy or lists. Labels are indices into
            ``class_names``, or names.

    Raises:
        RaucaError: anything else, or values that are not finite.
    """
    if not isinstance(answers, list | tuple) or len(answers) != len(images):
        raise RaucaError(
            f"{name}: answered {len(images)} images with {_kind(answers)}; return a list with one dict of "
            f"{', '.join(PARTS)} for each image"
        )
    return [_read(f"{name}: image {i} of the batch", one, images, class_names) for i, one in enumerate(answers)]


def above(found: Sequence[Detections], score_threshold: float) -> list[Detections]:
    """Those of the detections that are surer than a threshold."""
    kept = [one.scores > score_threshold for one in found]
    return [Detections(o.boxes[keep], o.scores[keep], o.labels[keep]) for o, keep in zip(found, kept, strict=True)]


def _read(where: str, answer: Any, images: Tensor, class_names: Sequence[str]) -> Detections:
    if isinstance(answer, Mapping) and all(part in answer for part in PARTS):
        answer = [answer[part] for part in PARTS]
    if not isinstance(answer, list | tuple) or len(answer) != 3:
        raise RaucaError(
            f"{where}: answered with {_kind(answer)}; return a dict with {', '.join(PARTS)}, or a tuple of the three"
        )
    boxes, scores = (_numbers(where, PARTS[i], answer[i]).to(images) for i in (0, 1))
    labels = _labels(where, answer[2], class_names).to(images.device)
    boxes = boxes.reshape(0, 4) if boxes.numel() == 0 else boxes
    if scores.ndim != 1 or labels.shape != scores.shape or boxes.shape != (len(scores), 4):
        shapes = ", ".join(f"{k} {tuple(one.shape)}" for k, one in zip(PARTS, (boxes, scores, labels), strict=True))
        raise RaucaError(f"{where}: {shapes}; expected boxes (M, 4), scores (M,) and labels (M,)")
    _check_values(where, boxes.detach(), scores.detach())
    order = scores.detach().argsort(descending=True, stable=True)
    return Detections(boxes[order], scores[order].clamp(0, 1), labels[order])


def _numbers(where: str, part: str, values: Any) -> Tensor:
    if isinstance(values, Tensor):
        return values
    try:
        return torch.from_numpy(np.array(values, np.float64))
    except (TypeError, ValueError, RuntimeError) as error:
        raise RaucaError(f"{where}: {part} are {_kind(values)}, expected numbers ({first_line(error)})") from error


def _labels(where: str, values: Any, class_names: Sequence[str]) -> Tensor:
    if not isinstance(values, Tensor) and any(isinstance(one, str) for one in np.atleast_1d(values)):
        known = {canonical(name): index for index, name in reversed(list(enumerate(class_names)))}
        written = [canonical(str(one)) for one in np.atleast_1d(values)]
        strange = next((one for one in written if one not in known), None)
        if strange is not None:
            raise RaucaError(f"{where}: label {strange!r} is none of the {len(class_names)} names that were given")
        return torch.tensor([known[one] for one in written])
    labels = _numbers(where, "labels", values).detach()
    wrong = labels[(labels != labels.round()) | (labels < 0) | (labels >= len(class_names))]
    if wrong.numel():
        raise RaucaError(
            f"{where}: label {wrong.flatten()[0].item():g}, expected an index into names, 0 to {len(class_names) - 1}; "
            "where the network's 0 is the background, write background as the first name"
        )
    return labels.long()


def _check_values(where: str, boxes: Tensor, scores: Tensor) -> None:
    if not (torch.isfinite(boxes).all() and torch.isfinite(scores).all()):
        raise RaucaError(f"{where}: boxes or scores hold NaN or infinite values")
    if ((scores < -ROUNDING) | (scores > 1 + ROUNDING)).any():
        raise RaucaError(
            f"{where}: scores from {scores.min().item():.3g} to {scores.max().item():.3g}, expected [0, 1]; return "
            "probabilities, not logits or percents"
        )
    turned = (boxes[:, 2:] < boxes[:, :2] - ROUNDING).any(1)
    if turned.any():
        told = ", ".join(f"{side:g}" for side in boxes[turned][0].tolist())
        raise RaucaError(f"{where}: box ({told}) ends before it begins; return corners x0, y0, x1, y1 in pixels")


def _kind(value: Any) -> str:
    """What a value is, in a few words."""
    shape = getattr(value, "shape", None)
    if shape is not None:
        return f"a {type(value).__name__} of shape {tuple(shape)}"
    if isinstance(value, Mapping):
        return f"a dict of {', '.join(map(str, list(value)[:5]))}" if value else "an empty dict"
    return f"a {type(value).__name__}" + (f" of {len(value)}" if isinstance(value, list | tuple) else "")
