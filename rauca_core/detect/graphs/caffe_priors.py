"""The anchors of caffe's SSD: what its PriorBox layer makes."""

from __future__ import annotations

import math

import numpy as np

from .layers import Array
from .prototxt import Block

PRIOR_OPTIONS = frozenset(
    {"min_size", "max_size", "aspect_ratio", "flip", "clip", "variance", "step", "step_h", "step_w", "offset"}
)


def prior_boxes(options: Block, extent: tuple[int, int], size: int) -> Array:
    """Anchors of one feature map, cell by cell in rows: (N, 4) center x, y, width, height, relative to the image.

    Args:
        options: ``prior_box_param``.
        extent: (rows, columns) of the feature map.
        size: of the square image, pixels.
    """
    sizes = _sizes(options)
    rows, columns = extent
    step = options.numbers("step") * 2 or [*options.numbers("step_h"), *options.numbers("step_w")]
    if len(step) not in (0, 2) or min(step, default=1) <= 0:
        options.fail("needs one positive step, or both step_h and step_w, or none of them")
    step_rows, step_columns = step or (size / rows, size / columns)
    offset = options.numbers("offset", [0.5])[0]
    y, x = np.meshgrid(
        (np.arange(rows) + offset) * step_rows, (np.arange(columns) + offset) * step_columns, indexing="ij"
    )
    centers = np.repeat(np.stack([x, y], -1).reshape(-1, 1, 2), len(sizes), axis=1)
    extents = np.broadcast_to(sizes, centers.shape)
    boxes = np.concatenate([centers, extents], -1).reshape(-1, 4) / size
    return _clipped(boxes) if options.flag("clip", False) else boxes


def variances(options: Block) -> Array:
    """(4,) factors on the encoded center x, y, width, height."""
    values = options.numbers("variance", [0.1])
    if len(values) not in (1, 4) or min(values) <= 0:
        options.fail(f"has variances {values}, expected one or four positive numbers")
    return np.broadcast_to(np.array(values, np.float64), 4)


def _sizes(options: Block) -> Array:
    """(K, 2) widths and heights of the anchors of one cell, pixels, in caffe's order."""
    smallest, largest = options.numbers("min_size"), options.numbers("max_size")
    ratios: list[float] = []
    for ratio in options.numbers("aspect_ratio"):
        for wanted in (ratio, 1 / ratio if ratio > 0 and options.flag("flip", True) else ratio):
            if not any(math.isclose(wanted, known, abs_tol=1e-6) for known in [1.0, *ratios]):
                ratios.append(wanted)
    if not smallest or min([*smallest, *ratios, *largest]) <= 0 or len(largest) not in (0, len(smallest)):
        options.fail("needs positive sizes and aspect ratios, and as many max_size as min_size or none")
    sizes = []
    for number, low in enumerate(smallest):
        sizes.append((low, low))
        if largest:
            sizes.append((math.sqrt(low * largest[number]),) * 2)
        sizes += [(low * math.sqrt(ratio), low / math.sqrt(ratio)) for ratio in ratios]
    return np.array(sizes)


def _clipped(boxes: Array) -> Array:
    low, high = (boxes[:, :2] + sign * boxes[:, 2:] / 2 for sign in (-1, 1))
    low, high = low.clip(0, 1), high.clip(0, 1)
    return np.concatenate([(low + high) / 2, high - low], axis=1)
