"""Fog around the vehicle from a coarse render and the clear view: cheaper than a whole render, the vehicle untouched.

What fog does to a picture is smooth: it dims what lies behind it, fills shadows, adds its own glow. So the scene is
rendered in fog on a grid four times as coarse, where noise is cheap to remove, and each neighborhood of that grid is
explained as a linear function of the clear picture behind transmittance (joint upsampling by a guided filter). The
fine picture is that function of the fine guides. The vehicle, whose color the light maps are about, and a margin
around it are always rendered in the real volume.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract

COARSE = 4  # pixels of the frame along a side of the coarse grid's pixels
COARSE_SAMPLES = 4  # times the frame's own
# 1/m; between these the composed day is 35 dB or more from the truth (`rauca bench dataset`). Thinner fog shows more of
# the clear frame's own noise; at night the lamps' halos are too small for the coarse grid.
THINNEST, DENSEST = 0.01, 0.06
RADIUS = 2  # of a neighborhood, coarse pixels
RIDGE = 1.0  # holds the weights near zero, where fog dims and glows and does no more; light in units of its median
GLOW_RIDGE = 1e-6  # the same for the constant weight, the glow
FARTHEST_M = 60.0  # of fog looked through: beyond, light comes from the layer's glow whatever lies behind it
# Display whites that are told apart. The sun's disc has half a million, and a fit that is to explain it as well leaves
# black holes beside it.
BRIGHTEST = 4.0
FEATHER_PX = 12  # over which the rendered vehicle's surroundings turn into the composed ones

Image = NDArray[np.float32]


def is_composed(quality: contract.Quality, weather: contract.Weather) -> bool:
    """True when this weather's fog is composed around the vehicle, not rendered everywhere."""
    wanted = quality.composed_fog and not weather.is_night and weather.fog_is_uniform
    return wanted and THINNEST <= weather.extinction <= DENSEST


def coarse_camera(camera: contract.Camera) -> contract.Camera:
    """The same view in pixels :data:`COARSE` times as large; the last row and column may reach beyond the frame."""
    K = camera.K.copy()
    K[:2] /= COARSE
    return contract.Camera(K, camera.R, camera.t, -(-camera.width // COARSE), -(-camera.height // COARSE))


def compose(coarse_linear: Image, clear_linear: Image, distance: NDArray[np.floating], extinction: float) -> Image:
    """The view in fog, (H, W, 3) linear; all that is brighter than :data:`BRIGHTEST` looks alike.

    Args:
        coarse_linear: the view in fog by :func:`coarse_camera`, (ceil(H / 4), ceil(W / 4), 3).
        clear_linear: the view without fog, (H, W, 3).
        distance: (H, W) metres along the view ray, infinity for sky.
        extinction: of the fog, 1/m.
    """
    coarse_linear, clear_linear = (np.minimum(image, BRIGHTEST) for image in (coarse_linear, clear_linear))
    height, width = clear_linear.shape[:2]
    unit = max(float(np.median(coarse_linear)), 1e-4)
    seen_through = np.exp(-extinction * np.minimum(distance.astype(np.float64), FARTHEST_M))
    behind = seen_through[..., None] * clear_linear / unit
    brightness = np.sqrt(np.maximum(behind.mean(axis=-1), 0.0))  # tells shadow from light where a color is dark
    shared = np.stack([brightness, seen_through, np.ones_like(seen_through)], axis=-1)
    composed = np.empty(clear_linear.shape, np.float32)
    for channel in range(3):
        guides = np.concatenate([behind[..., channel, None], shared], axis=-1)
        # What is explained is the difference from mere dimming: where the fit knows nothing, dimming it is.
        low = coarsen(guides)
        weights = _refine(_explain(coarse_linear[..., channel] / unit - low[..., 0], low), height, width)
        composed[..., channel] = unit * (guides[..., 0] + (guides * weights).sum(axis=-1))
    return np.maximum(composed, 0.0)


def blend(composed: Image, rendered: Image, inside: tuple[slice, slice]) -> Image:
    """``composed`` with a rendered part put in; the part's outer pixels fade, except along the frame's own border."""
    rows, columns = inside
    across = _ramp(rows, composed.shape[0])[:, None] * _ramp(columns, composed.shape[1])
    result = composed.copy()
    result[inside] += across[..., None].astype(np.float32) * (rendered - composed[inside])
    return result


def _explain(target: NDArray[np.floating], guides: NDArray[np.float64]) -> NDArray[np.float64]:
    """Per pixel the weights (h, w, K) with which the guides (h, w, K) best make the target (h, w) around it."""
    moments = _mean(guides[..., :, None] * guides[..., None, :])
    moments += np.diag([RIDGE] * (guides.shape[-1] - 1) + [GLOW_RIDGE])  # the last guide is the fog's own glow
    shares = _mean(guides * target[..., None])
    return _mean(np.linalg.solve(moments, shares[..., None])[..., 0])


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over squares of ``2 * RADIUS + 1`` pixels, cut off at the border. float64: running sums cancel."""
    for axis in (0, 1):
        count = values.shape[axis]
        sums = np.cumsum(np.concatenate([np.zeros_like(values.take([0], axis)), values], axis), axis, np.float64)
        first = np.maximum(np.arange(count) - RADIUS, 0)
        end = np.minimum(np.arange(count) + RADIUS + 1, count)
        lengths = (end - first).reshape([-1 if a == axis else 1 for a in range(values.ndim)])
        values = (sums.take(end, axis) - sums.take(first, axis)) / lengths
    return values


def coarsen(fine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over the coarse grid's pixels; beyond the frame the last row and column repeat."""
    height, width, kinds = fine.shape
    whole = np.pad(fine, ((0, -height % COARSE), (0, -width % COARSE), (0, 0)), mode="edge")
    return whole.reshape(whole.shape[0] // COARSE, COARSE, whole.shape[1] // COARSE, COARSE, kinds).mean(axis=(1, 3))


def _refine(coarse: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """Bilinear from the coarse grid's pixel centers to the frame's."""
    for axis, count in ((0, height), (1, width)):
        last = coarse.shape[axis] - 1
        place = np.clip((np.arange(count) + 0.5) / COARSE - 0.5, 0.0, last)
        low = np.minimum(place.astype(int), max(last - 1, 0))
        share = (place - low).reshape([-1 if a == axis else 1 for a in range(coarse.ndim)])
        coarse = coarse.take(low, axis) * (1 - share) + coarse.take(np.minimum(low + 1, last), axis) * share
    return coarse


def _ramp(part: slice, count: int) -> NDArray[np.float64]:
    """1 inside ``part`` of ``count`` pixels, falling to 0 over its outer ones; an end at the frame's border stays 1."""
    at = np.arange(part.start, part.stop) + 0.5
    rise = np.ones(len(at)) if part.start == 0 else np.clip((at - part.start) / FEATHER_PX, 0, 1)
    fall = np.ones(len(at)) if part.stop == count else np.clip((part.stop - at) / FEATHER_PX, 0, 1)
    return np.minimum(rise, fall)
