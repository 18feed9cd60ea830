"""PAD's two heat maps: how much neighboring windows tell about each other, and where JPEG changes most."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from .reference import round_trip
from .smooth_jpeg import smooth_jpeg

SMALLEST_WINDOW = 8
LEVELS = 256


def window_side(height: int, width: int) -> int:
    """Side of PAD's windows, pixels: a hundredth of the longer side, even, at least 8."""
    hundredth = -(-max(height, width) // 100)
    return max(SMALLEST_WINDOW, hundredth + hundredth % 2)


def mutual_information_map(grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean mutual information, nats, of the window around each pixel with its neighbors above, below, left and right.

    Windows of :func:`window_side` overlap by half; the image is mirrored at its border; between the windows' centers
    the map is interpolated. Like the published code, this is the plug-in estimate over 256 grey levels from the few
    pixels of a window: high where grey values hardly repeat, as in noise and in fine texture, and 0 where it is flat.

    Args:
        grey: (H, W) 8-bit.
    """
    height, width = grey.shape
    side = window_side(height, width)
    stride = side // 2
    padded = np.pad(grey, stride, mode="symmetric").astype(np.uint16)
    windows = sliding_window_view(padded, (side, side))[::stride, ::stride]
    windows = np.ascontiguousarray(windows).reshape(*windows.shape[:2], -1)
    means = _mean_over_neighbors(windows)
    # Window i reaches from (i - 1) to (i + 1) strides: its center lies on the pixel edge i * stride.
    at_y, at_x = ((np.arange(size, dtype=np.float32) + 0.5) / stride for size in (height, width))
    grid_x, grid_y = np.meshgrid(at_x, at_y)
    heat = cv2.remap(means, grid_x, grid_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(heat, np.float32)


def _mean_over_neighbors(windows: NDArray[np.uint16]) -> NDArray[np.float32]:
    """(rows, columns, pixels) windows half a side apart -> (rows, columns); neighbors are those that just touch."""
    rows, columns, _ = windows.shape
    entropy = _entropy(windows)
    total, neighbors = np.zeros((rows, columns)), np.zeros((rows, columns))
    for axis in (0, 1):
        if windows.shape[axis] <= 2:
            continue  # no two windows touch without overlap
        first: tuple[slice, ...] = (slice(None),) * axis + (slice(None, -2),)
        second: tuple[slice, ...] = (slice(None),) * axis + (slice(2, None),)
        joint = _entropy(windows[first] * LEVELS + windows[second])
        information = entropy[first] + entropy[second] - joint
        for place in (first, second):
            total[place] += information
            neighbors[place] += 1
    return (total / np.maximum(neighbors, 1)).astype(np.float32)


def _entropy(symbols: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Shannon entropy, nats, of the symbols along the last axis."""
    shape, pixels = symbols.shape[:-1], symbols.shape[-1]
    ordered = np.sort(symbols.reshape(-1, pixels), axis=1)
    starts = np.ones(ordered.shape, bool)
    starts[:, 1:] = ordered[:, 1:] != ordered[:, :-1]
    positions = np.flatnonzero(starts)
    counts = np.diff(positions, append=ordered.size)
    weighted = np.bincount(positions // pixels, counts * np.log(counts), minlength=len(ordered))
    return (np.log(pixels) - weighted / pixels).reshape(shape)


QUALITIES = range(51, 101)
SMOOTHING_PIXELS = 17


def recompression_map(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean over JPEG qualities 51 to 100 of the smoothed squared difference to the re-saved image, (H, W) in [0, 1].

    At every quality the difference is averaged over 17x17 pixels and scaled to [0, 1] over the image. A region whose
    history of compression differs from the rest stands out; so does fine texture where there is no such history.

    Args:
        pixels: (H, W, 3) 8-bit RGB.
    """
    total = np.zeros(pixels.shape[:2], np.float32)
    for quality in QUALITIES:
        difference = cv2.absdiff(pixels, round_trip(pixels, quality)).astype(np.float32)
        squared = np.square(difference).mean(axis=2)
        total += scaled(cv2.blur(squared, (SMOOTHING_PIXELS, SMOOTHING_PIXELS), borderType=cv2.BORDER_REFLECT))
    return total / len(QUALITIES)


SMOOTH_QUALITIES = (55, 75, 95)  # that stand for all of them


def smooth_heat(images: Tensor, weight: float) -> Tensor:
    """PAD's fused map as a differentiable function: (B, 3, H, W) sRGB in [0, 1] -> (B, 1, H, W) in [0, 1].

    From 64 pixels, the plug-in estimate of mutual information follows how many grey values a window holds, so the
    logarithm of their spread stands for it; of the recompression, three qualities and the smooth codec.

    Args:
        weight: of the first map.
    """
    grey = 255 * torch.einsum("c,bchw->bhw", torch.tensor((0.299, 0.587, 0.114)).to(images), images)[:, None]
    side = window_side(*images.shape[2:]) | 1
    variance = _blurred(grey.square(), side) - _blurred(grey, side).square()
    spread = (variance.clamp(min=0) + 1).log()
    total = torch.zeros_like(grey)
    for quality in SMOOTH_QUALITIES:
        squared = (255 * (images - smooth_jpeg(images, quality))).square().mean(1, keepdim=True)
        total = total + _scaled_each(_blurred(squared, SMOOTHING_PIXELS)) / len(SMOOTH_QUALITIES)
    return weight * _scaled_each(spread) + (1 - weight) * _scaled_each(total)


def _blurred(maps: Tensor, side: int) -> Tensor:
    """(B, 1, H, W) averaged over squares of an odd side; the border is repeated."""
    padded = functional.pad(maps, (side // 2,) * 4, mode="replicate")
    return functional.avg_pool2d(functional.avg_pool2d(padded, (side, 1), 1), (1, side), 1)


def _scaled_each(maps: Tensor) -> Tensor:
    """As :func:`scaled`, each of (B, 1, H, W) by its own range, which counts as constant."""
    low, high = (ends((2, 3), keepdim=True).detach() for ends in (maps.amin, maps.amax))
    return (maps - low) / torch.where(high > low, high - low, 1)


def scaled(heat: NDArray[np.float32]) -> NDArray[np.float32]:
    """From its own range to [0, 1]; 0 where the heat is the same everywhere."""
    low, high = heat.min(), heat.max()
    return (heat - low) / (high - low) if high > low else np.zeros_like(heat)
