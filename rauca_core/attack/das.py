"""What DAS alone needs: a loss on a detector's attention, and the picture that its paint of some panels starts from.

The map of attention is Grad-CAM's: channels of the backbone's last features, weighted by how much each raises the
vehicle's score. Regions of positive attention that hang together are costly when they are strong and large, so that
what is left of the attention is weak and in small pieces.

DAS paints parts of the body only, and keeps its paint close to a picture that people find harmless, a smiling face,
whose lines count most. Which faces belong to a panel is read off the geometry: any car has a bonnet, a roof and doors,
but no two meshes name them alike.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ..contract import RaucaError, Vehicle
from ..detect import Detector
from ..detect.darknet_network import DarknetNetwork, Head, Route, precise
from ..render import cell_positions

SCORE_EDGE = 1e-6  # from 0 and 1: beyond, the log-odds of a score have no slope


def attention_layer(detector: Detector) -> nn.Module:
    """The module whose output (B, C, h, w) attention is read from.

    A detector may name it as ``attention_layer``. Of a darknet network it is the last layer that all heads share.

    Raises:
        RaucaError: neither of the two.
    """
    named, network = getattr(detector, "attention_layer", None), getattr(detector, "network", None)
    if isinstance(named, nn.Module):
        return named
    if isinstance(network, DarknetNetwork):
        layers = list(network.layers)
        first = next(i for i, layer in enumerate(layers) if isinstance(layer, Head))
        after = next((layer for layer in layers[first:] if isinstance(layer, Route)), None)
        return layers[first - 2 if after is None else after.sources[0]]
    raise RaucaError(f"{detector.name}: its attention cannot be read; choose a yolov2, yolov3 or yolov4")


@contextlib.contextmanager
def watching(layer: nn.Module | None) -> Iterator[list[Tensor]]:
    """What the layer puts out while the block runs, the latest last; nothing without a layer."""
    seen: list[Tensor] = []

    def keep(_module: nn.Module, _given: Any, output: Tensor) -> None:
        seen.append(output)

    handle = None if layer is None else layer.register_forward_hook(keep)
    try:
        yield seen
    finally:
        if handle is not None:
            handle.remove()


def attention_map(score: Tensor, features: Tensor) -> Tensor:
    """Grad-CAM (B, h, w) of the log-odds of ``score`` (B,), differentiable by way of ``features`` (B, C, h, w).

    The channels' weights are constants of it, as published; but sums of their slopes, not means: a classifier pools
    all cells, a detector's score hangs on a few, and its map would all but vanish. Positive where the vehicle's score
    comes from.
    """
    slopes = None
    if score.requires_grad:
        evidence = torch.logit(score.clamp(SCORE_EDGE, 1 - SCORE_EDGE)).sum()
        (slopes,) = torch.autograd.grad(evidence, features, retain_graph=True, allow_unused=True)
    features = precise(features)  # after the slopes: what a network in bfloat16 reads is not this copy
    weights = torch.zeros_like(features) if slopes is None else precise(slopes)
    return (features * weights.sum((2, 3), keepdim=True)).sum(1)


def dispersed_attention(score: Tensor, features: Tensor) -> Tensor:
    """DAS's loss (B,): the mean over connected regions of ``sum(tanh attention) / (cells + 1 - cells of the region)``.

    Cells with an edge in common hang together.
    """
    strength = attention_map(score, features).tanh()
    return torch.stack([_scatter(one) for one in strength])


def _scatter(strength: Tensor) -> Tensor:
    import cv2  # here: only this objective needs it

    positive = (strength.detach() > 0).cpu().numpy().astype(np.uint8)
    count, labels = cv2.connectedComponents(positive, connectivity=4)
    if count <= 1:  # the background alone
        return (strength * 0.0).sum()
    regions = torch.from_numpy(labels.astype(np.int64)).to(strength.device).ravel()
    sums = strength.new_zeros(count).index_add(0, regions, strength.ravel())
    sizes = torch.bincount(regions, minlength=count)
    return (sums / (strength.numel() + 1 - sizes))[1:].mean()


FACING = 0.7  # cosine: a face belongs to a panel that looks less than 46 degrees away from its axis
LINE = 0.07  # half width of the picture's lines, of its radius
SKIN, INK = (0.95, 0.80, 0.15), (0.08, 0.06, 0.05)  # sRGB


@dataclass(frozen=True)
class BodyPanel:
    """A part of the body.

    Attributes:
        axis, sign: where it looks.
        low, high: of its faces' centers, as shares of the vehicle's box along x (rear to front), y and z.
        right, up: the axes of the picture on it, times the signs in ``turn``: upright to whoever stands before it.
    """

    axis: int
    sign: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    right: int
    up: int
    turn: tuple[float, float]


PANELS = {
    "bonnet": BodyPanel(2, 1.0, (0.70, 0.0, 0.3), (1.0, 1.0, 0.85), 1, 0, (1.0, -1.0)),
    "roof": BodyPanel(2, 1.0, (0.0, 0.0, 0.85), (1.0, 1.0, 1.0), 1, 0, (1.0, -1.0)),
    "left doors": BodyPanel(1, 1.0, (0.28, 0.5, 0.15), (0.70, 1.0, 0.7), 0, 2, (-1.0, 1.0)),
    "right doors": BodyPanel(1, -1.0, (0.28, 0.0, 0.15), (0.70, 0.5, 0.7), 0, 2, (1.0, 1.0)),
}


def panel_faces(vehicle: Vehicle) -> dict[str, NDArray[np.int64]]:
    """For each panel its faces, as places among the paint faces; a vehicle may lack some."""
    corners = vehicle.positions[vehicle.triangles[vehicle.paint_faces()]].astype(np.float64)
    low, high = vehicle.positions.min(0), vehicle.positions.max(0)
    place = (corners.mean(1) - low) / np.maximum(high - low, 1e-9)
    normals = vehicle.normals[vehicle.paint_faces()].mean(1)  # shading normals: they point outwards, windings may not
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    found = {}
    for name, panel in PANELS.items():
        inside = ((place >= panel.low) & (place <= panel.high)).all(1)
        found[name] = np.flatnonzero(inside & (normals[:, panel.axis] * panel.sign > FACING))
    return found


def seed_paint(
    vehicle: Vehicle, reference_srgb: tuple[int, int, int], texture_size: int
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
    """The cells of all panels (M,), the smiling face on them (M, 3) sRGB, and 1 on its lines, else 0 (M,).

    Args:
        reference_srgb: 8-bit, of the paint around the face.
        texture_size: ts of the facet texture tensor.

    Raises:
        RaucaError: the vehicle has none of the panels.
    """
    positions = cell_positions(vehicle, texture_size).reshape(-1, texture_size**3, 3)
    cells, colors, edges = [], [], []
    for name, faces in panel_faces(vehicle).items():
        if not len(faces):
            continue
        panel, points = PANELS[name], positions[faces].reshape(-1, 3)
        plane = points[:, [panel.right, panel.up]] * panel.turn
        low, high = plane.min(0), plane.max(0)
        paint, line = smile((plane - (low + high) / 2) / max((high - low).min() / 2, 1e-6), reference_srgb)
        cells.append((faces[:, None] * texture_size**3 + np.arange(texture_size**3)).ravel())
        colors.append(paint)
        edges.append(line)
    if not cells:
        raise RaucaError(f"{vehicle.name}: no paint on a bonnet, roof or door; cover all of it")
    return np.concatenate(cells), np.concatenate(colors), np.concatenate(edges)


def smile(
    points: NDArray[np.floating], reference_srgb: tuple[int, int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A smiling face of radius 0.9 about 0: colors (N, 3) sRGB and lines (N,) at points (N, 2), x right, y up."""
    x, y = points.T
    radius = np.hypot(x, y)
    eyes = np.hypot((np.abs(x) - 0.32) / 0.12, (y - 0.3) / 0.18) < 1
    mouth = (np.abs(np.hypot(x, y - 0.1) - 0.6) < LINE) & (y < -0.15)
    line = eyes | mouth | (np.abs(radius - 0.9) < LINE)
    colors = np.where(radius[:, None] < 0.9, SKIN, np.array(reference_srgb) / 255)
    return np.where(line[:, None], INK, colors).astype(np.float32), line.astype(np.float32)
