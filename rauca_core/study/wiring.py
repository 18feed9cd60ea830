"""Is a detector wired up as it was trained? The usual mistakes, each tried on pictures of plain cars."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from ..detect import Detector
from ..detect.nms import corners
from .plain_cars import Look, Reading

FORMS: dict[str, Callable[[int], Reading]] = {
    "shares of the image": lambda size: lambda boxes: boxes * size,
    "center, width and height": lambda size: corners,
    "corner, width and height": lambda size: lambda boxes: torch.cat([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], 1),
    "center, width and height in shares of the image": lambda size: lambda boxes: corners(boxes * size),
    "y0, x0, y1, x1": lambda size: lambda boxes: boxes[:, [1, 0, 3, 2]],
}
"""What boxes may be in place of xyxy pixels, each with its reading for images of a size."""

SWAPPED = "with red and blue swapped: is it given RGB where it was trained on BGR, or the other way round?"
DIVIDED = "with values divided by 255: is it given 0..255 where it was trained on 0..1?"
INPUTS: dict[str, Callable[[Tensor], Tensor]] = {
    SWAPPED: lambda images: images.flip(1),
    DIVIDED: lambda images: images / 255,
}
"""What is done to sRGB images (N, 3, H, W) in [0, 1], and what it would mean that this helps."""

NONE_OF_THEM = (
    "names in another order, boxes in another form, red and blue swapped, and 0..255 in place of 0..1 were tried and "
    "do not explain it: look at the mean and standard deviation that images are normalized by, at the input size "
    "(--size), and at whether it was trained on cars in streets"
)
CLEARLY_SURER, FEWEST = 0.02, 8


def explanations(detector: Detector, images: Tensor, look: Look, index: int, threshold: float) -> list[str]:
    """What would let a detector find clearly more of the cars, in sentences; never empty.

    Args:
        images: sRGB (N, 3, H, W) in [0, 1], those of ``look`` or more.
        index: the class that cars are to be found as.
        threshold: score from which they count.
    """
    shown, own = len(look.truths), look.found(index, threshold)

    def helps(count: int) -> bool:
        return count >= max(own + 2, shown / 2)

    said = []
    label, count = look.best_label(threshold)
    if label != index and helps(count):
        said.append(f"it finds {count} of {shown} as class {label}, {_names(detector.class_names, label, index)}")
    for form, read in FORMS.items():
        if helps(count := look.found(index, threshold, read(look.size))):
            said.append(f"it finds {count} of {shown} if its boxes are {form}: give x0, y0, x1, y1 in pixels")
    for change, changed in INPUTS.items():
        if helps(count := Look.at(detector, changed(images[:shown]), look.truths).found(index, threshold)):
            said.append(f"it finds {count} of {shown} {change}")
    return said or [NONE_OF_THEM]


def _names(names: tuple[str, ...], label: int, index: int) -> str:
    """What it means that cars are found as class ``label``, not ``index``."""
    called = repr(names[label]) if label < len(names) else "which has no name"
    why = "are the names in another order?"
    if label == index - 1:
        why = "one lower: are the names one off, with a background that the network does not count?"
    elif label == index + 1:
        why = "one higher: are the names one off, without a background that the network counts?"
    return f"{called}, where {index} is {names[index]!r}; {why} --names FILE gives them in the network's order"


def swapped_colors(detector: Detector, images: Tensor, look: Look, index: int) -> list[str]:
    """A sentence where a detector that sees the cars is clearly surer of them with red and blue swapped.

    A wrong order costs a detector few cars but some certainty in most pictures: the mean gain of the score must be
    twice its standard error. Fewer than eight pictures say too little.
    """
    if len(look.truths) < FEWEST:
        return []
    images = images[: len(look.truths)].flip(1)
    gain = Look.at(detector, images, look.truths).scores(index) - look.scores(index)
    surer = gain.mean() > max(CLEARLY_SURER, 2 * gain.std(ddof=1) / np.sqrt(len(gain)))
    return [f"it is surer of the cars, by {gain.mean():.2f} of score, {SWAPPED}"] if surer else []
