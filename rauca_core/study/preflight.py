"""Is a detector ready to be assessed? A minute's look at it, before anything is rendered or optimized.

It is shown a dozen shipped pictures of plain cars. Where it sees few of them, the usual mistakes are tried one by one:
names that are one off, boxes in another form, red and blue swapped, another range of values.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from torch import Tensor

from ..contract import RaucaError
from ..contract.schema import Record
from ..detect import Detector, find_class
from ..detect.foreign import first_line
from .average_precision import average_precision
from .cost import Cost, Work, cost_of
from .plain_cars import Look, plain_cars
from .wiring import explanations, swapped_colors

DEPLOYED = 0.25
"""The score at which Ultralytics' detectors and most others are used."""
ENOUGH_AP = 0.5
LOOK_S, FEWEST = 10.0, 4  # a slow detector is shown fewer pictures
GRADIENTS, GRADIENT_S = 3, 5.0


@dataclass(frozen=True)
class Preflight(Record):
    """What was found out about a detector.

    Attributes:
        family: which adapter speaks for it, such as ``darknet``; of an ONNX file also what it was read as.
        category, class_index: the class that cars are to be found as, and its place among ``class_names``.
        input_size: the longer side of the network's input, pixels; None where it depends on the image.
        differentiable: gradients reach the image, so that the detector itself can be attacked.
        why_not: the reason where they do not, and what to do about it.
        pictures: plain cars that it was shown.
        ap: AP@0.5 of them.
        found: of them, at a score of 0.25 and an overlap of 0.5.
        ms_forward, ms_step: an image seen, and seen with the way back to its pixels; medians, batches of one.
        warnings: what should be seen to before an assessment; each is a sentence or two.
        costs: of each kind of work that was asked about.
    """

    FORMAT = ("rauca-preflight", 1)

    name: str
    family: str
    class_names: tuple[str, ...]
    category: str
    class_index: int
    input_size: int | None
    differentiable: bool
    why_not: str
    pictures: int
    ap: float
    found: int
    ms_forward: float
    ms_step: float | None
    warnings: tuple[str, ...] = ()
    costs: dict[str, Cost] = field(default_factory=dict)


def preflight(
    detector: Detector, category: str = "car", works: Mapping[str, Work] | None = None, device: str = "cpu"
) -> Preflight:
    """Look at a detector; under a minute on two cores for those that need less than two seconds an image.

    Args:
        category: the class that cars are to be found as.
        works: what to tell the cost of, by name, such as the budgets of an assessment.
        device: that the detector lies on.

    Raises:
        RaucaError: it has no such class, or refuses the pictures.
    """
    images, truths = plain_cars()
    images = images.to(device)
    first_s = _seconds(detector, images[:1])
    shown = int(max(FEWEST, min(len(images), LOOK_S // max(first_s, 1e-3))))
    look = Look.at(detector, images[:shown], truths[:shown])
    index = find_class(detector.class_names, category)
    if index is None:
        raise RaucaError(_no_class(detector, category, look))
    ap, found = average_precision(look.samples(index)), look.found(index, DEPLOYED)
    why_not, ms_step = _gradient(detector, images[look.middling(index)], index)
    warnings = [f"it cannot be attacked itself: {why_not}"] if why_not else []
    if ap < ENOUGH_AP:
        few = f"it sees few of the plain cars: AP@0.5 is {ap:.2f}, {found} of {shown} are found at {DEPLOYED:g}"
        warnings += [few, *explanations(detector, images, look, index, DEPLOYED)]
    else:
        warnings += swapped_colors(detector, images, look, index)
    ms_forward = round(look.milliseconds, 2)
    return Preflight(
        detector.name, _family(detector), tuple(detector.class_names), category, index,
        _size(detector), not why_not, why_not, shown, round(ap, 4), found, ms_forward, ms_step,
        tuple(warnings), {name: cost_of(work, ms_forward, ms_step) for name, work in (works or {}).items()},
    )  # fmt: skip


def _seconds(detector: Detector, image: Tensor) -> float:
    """Of the second look: the first one makes tables and compiles."""
    detector.detect(image)
    began = time.perf_counter()
    detector.detect(image)
    return time.perf_counter() - began


def _size(detector: Detector) -> int | None:
    size = getattr(detector, "size", None)
    return size if isinstance(size, int) else None


def _family(detector: Detector) -> str:
    inner = getattr(detector, "detector", detector)  # of one whose classes are renamed
    family = type(inner).__name__.removesuffix("Detector").lower() or "detector"
    kind = getattr(inner, "kind", "")  # what a file was recognized as, where it does not say
    return f"{family}: {kind}" if kind else family


def _no_class(detector: Detector, category: str, look: Look) -> str:
    """The detector lacks the class; what does it call the cars?"""
    names, (label, count) = detector.class_names, look.best_label(DEPLOYED)
    if count < len(look.truths) / 2 or label >= len(names):
        said, own = f"none of its {len(names)} classes ({', '.join(names[:4])} ...) is {category!r}", "OWN"
    else:
        own = names[label]
        said = f"calls {count} of {len(look.truths)} plain cars {own!r}, and knows no class {category!r}"
    return f"{detector.name}: {said}; give --classes '{own}={category}'"


def _gradient(detector: Detector, image: Tensor, index: int) -> tuple[str, float | None]:
    """Why no gradient of the best score reaches the image, empty where it does; and milliseconds there and back."""
    spent: list[float] = []
    while len(spent) <= GRADIENTS and sum(spent) < 1000 * GRADIENT_S:
        began, pixels = time.perf_counter(), image[None].clone().requires_grad_()
        try:
            found = detector.dense(pixels)
            if not found.boxes.shape[1]:
                return f"{detector.name}: has no prediction before suppression, so no score to lower", None
            best = (found.objectness * found.classes[..., index]).amax()
            if not best.requires_grad:
                return f"{detector.name}: no gradient flows from its scores to the image; {_IN_TORCH}", None
            best.backward()
        except RaucaError as error:
            return str(error), None
        except RuntimeError as error:  # of torch, in the way back
            return f"{detector.name}: the way back from its scores fails ({first_line(error)}); {_IN_TORCH}", None
        if pixels.grad is None or not pixels.grad.isfinite().all():
            return f"{detector.name}: the gradient of its best score is not finite; compute in float32", None
        if not pixels.grad.any():
            return f"{detector.name}: the gradient of its best score is 0 everywhere; {_ROUNDED}", None
        spent.append(1000 * (time.perf_counter() - began))
    return "", round(statistics.median(spent[1:] or spent), 2)


_IN_TORCH = "compute them from the image by torch's operations, without no_grad, detach or NumPy"
_ROUNDED = "where it rounds or is quantized, give the network in floating point"
