"""The fog between a camera and what it sees: how much it dims, and how much of its own glow it adds.

A source's light is kept as it is without fog, and a new view gets the fog of its own distances. What dims is known
(`environment.air`). The glow is that of a layer that glows alike everywhere and is the brighter the nearer one looks
towards the sun: B = T L + (1 - T) S(direction). Two sources that see one point differ in T and direction alone, so
that S follows by least squares from such pairs, L dropping out. No point is darker than the glow before it: L >= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...contract import Weather
from ..air import transmittance
from .lens import FAR_M, Lens
from .sources import SAME_POINT

Image = NDArray[np.float32]
Array = NDArray[np.float64]

STEP = 5  # pixels, of those that are paired
THINNEST = 0.05  # light that is dimmed more than this is taken for glow
MIRRORS_ALIKE = 0.3  # radians between two lines of sight: the farther apart, the less what mirrors is the same in both
RIDGE = 1e-3  # of the mean square of the equations
COARSE = 8  # pixels between directions that the glow is computed in
LEAST = 1e-6  # linear light that counts as none
ROUNDS = 6  # of least squares, each with less weight on what mirrors and more on what is darker than its glow
DARKER = 0.03  # weight of all pixels darker than the glow before them, were they as many as the equations


@dataclass(frozen=True, eq=False)
class FogGlow:
    """Of one place and weather.

    Attributes:
        coefficients: (5, 3) of S, linear RGB, see :func:`_directions`.
    """

    weather: Weather
    coefficients: Array

    @staticmethod
    def of(weather: Weather, lenses: Sequence[Lens], depths: Image, light: Image) -> FogGlow | None:
        """Fit it to sources.

        Args:
            depths: (N, H, W) metres along z, 0 where mixed.
            light: (N, H, W, 3) B, linear, without rain and exposure.

        Returns:
            None without fog, where no two sources see the same point, and at night: lamps do not glow alike everywhere.
        """
        if weather.extinction == 0.0 or weather.is_night or len(lenses) < 2:
            return None
        seen = [
            _Seen(lens, depth, one, _share_left(weather, lens, depth))
            for lens, depth, one in zip(lenses, depths, light, strict=True)
        ]
        equations = [_pairs(weather, *two) for two in permutations(seen, 2)]
        bounds = [_bounds(weather, one) for one in seen]
        design, target, most, most_light = (
            np.concatenate(some) for both in (equations, bounds) for some in zip(*both, strict=True)
        )
        return FogGlow(weather, _robust(design, target, most, most_light)) if len(design) > 100 else None

    def at(self, lens: Lens, depth: Image) -> tuple[Image, Image]:
        """Share (H, W) of light that reaches the camera from ``depth`` (H, W), metres along z, and glow (H, W, 3). Of
        the sky and where depth is 0 they are 1 and 0: the sky is the same from everywhere, with its glow."""
        left = _share_left(self.weather, lens, depth)
        return left, (1 - left)[..., None] * self._brightness(lens, *depth.shape)

    def lay_before(self, lens: Lens, *layers: tuple[Image, Image]) -> list[Image]:
        """Dim the light (H, W, 3) of each layer from its depth (H, W), and let the fog before it glow.

        The light is changed in place.

        Returns:
            what share (H, W) is left of each.
        """
        brightness, shares = self._brightness(lens, *layers[0][1].shape), []
        for light, depth in layers:
            left = _share_left(self.weather, lens, depth)
            light *= left[..., None]
            light += (1 - left)[..., None] * brightness
            shares.append(left)
        return shares

    def _brightness(self, lens: Lens, height: int, width: int) -> Image:
        """S (H, W, 3) in the directions of all pixels; it is smooth, so a coarse grid of it is enough."""
        x, y = (np.linspace(0, side, side // COARSE + 2) for side in (width, height))
        grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        _, rays = _points(lens, grid[:, 0], grid[:, 1], np.ones(len(grid), np.float32))
        coarse = np.maximum(_directions(self.weather, rays) @ self.coefficients, 0).astype(np.float32)
        columns, rows = np.meshgrid(
            (np.arange(width, dtype=np.float32) + 0.5) / width * (len(x) - 1),
            (np.arange(height, dtype=np.float32) + 0.5) / height * (len(y) - 1),
        )
        return np.asarray(cv2.remap(coarse.reshape(len(y), len(x), 3), columns, rows, cv2.INTER_LINEAR), np.float32)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a source sees: depth (H, W), light (H, W, 3), and the share (H, W) of light that the fog let through."""

    lens: Lens
    depth: Image
    light: Image
    left: Image


def _share_left(weather: Weather, lens: Lens, depth: Image) -> Image:
    """Share (H, W) of light from a depth (H, W) that reaches the camera, at least :data:`THINNEST`; 1 of the sky."""
    height, width = depth.shape
    if weather.fog_is_uniform:
        left: Image = np.exp(depth * lens.lengths(height, width) * np.float32(-weather.extinction))
    else:
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        points, _ = _points(lens, x.ravel(), y.ravel(), depth.ravel())
        left = transmittance(weather, lens.eye, points).astype(np.float32).reshape(height, width)
    left = np.maximum(left, np.float32(THINNEST))
    left[depth > 0.5 * FAR_M] = 1
    return left


def _points(lens: Lens, x: Array, y: Array, depth: Image) -> tuple[Array, Array]:
    """What lies at pixels (N,) x, y and depths: points (N, 3) in the world, and unit directions (N, 3) to them."""
    rays = np.stack([x, y, np.ones(len(x))], 1) @ lens.rays.T
    return lens.eye + rays * depth[:, None], rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _directions(weather: Weather, rays: Array) -> Array:
    """(N, 5) what S is made of in directions (N, 3): even, up, and powers of the cosine to the sun."""
    up, around = np.radians([weather.sun_altitude_angle, weather.sun_azimuth_angle])
    sun = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    near = np.clip(rays @ sun, 0, 1)
    return np.stack([np.ones(len(rays)), rays[:, 2], near, near**4, near**16], 1)


def _sampled(one: _Seen) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
    """Rows and columns (N,) of every :data:`STEP`-th pixel without sky, and what is there, as :func:`_points` says."""
    height, width = one.depth.shape
    r, c = (k.ravel() for k in np.mgrid[STEP // 2 : height : STEP, STEP // 2 : width : STEP])
    solid = (one.depth[r, c] > 0) & (one.depth[r, c] < 0.5 * FAR_M)
    r, c = r[solid], c[solid]
    return r, c, *_points(one.lens, c + 0.5, r + 0.5, one.depth[r, c])


def _pairs(weather: Weather, one: _Seen, two: _Seen) -> tuple[Array, Array]:
    """Equations of points that both sources see: (M, 5) times coefficients is (M, 3)."""
    height, width = one.depth.shape
    r, c, points, rays = _sampled(one)
    there = np.column_stack([points, np.ones(len(points))]) @ two.lens.matrix.T
    inside = there[:, 2] > 0.1
    x, y = (np.where(inside, there[:, k] / np.where(inside, there[:, 2], 1), -1) for k in (0, 1))
    inside &= (x >= 0) & (x < width) & (y >= 0) & (y < height)
    cc, rr = np.where(inside, x, 0).astype(np.int64), np.where(inside, y, 0).astype(np.int64)
    inside &= np.abs(two.depth[rr, cc] - there[:, 2]) < SAME_POINT * there[:, 2]
    (r, c, rr, cc), points, rays = (k[inside] for k in (r, c, rr, cc)), points[inside], rays[inside]
    back = points - two.lens.eye
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    t, u = one.left[r, c].astype(np.float64), two.left[rr, cc].astype(np.float64)
    # t L + (1 - t) S = B and u L + (1 - u) S' = B': u B - t B' is free of L.
    design = (u * (1 - t))[:, None] * _directions(weather, rays) - (t * (1 - u))[:, None] * _directions(weather, back)
    apart = np.arccos(np.clip((rays * back).sum(1), -1, 1))
    alike = (1 / (1 + (apart / MIRRORS_ALIKE) ** 2))[:, None]
    return alike * design, alike * (u[:, None] * one.light[r, c] - t[:, None] * two.light[rr, cc])


def _bounds(weather: Weather, one: _Seen) -> tuple[Array, Array]:
    """What the glow before a source's points is at most: (M, 5) times coefficients is below its light (M, 3)."""
    r, c, _, rays = _sampled(one)
    left, light = (image[r, c].astype(np.float64) for image in (one.left, one.light))
    return (1 - left)[:, None] * _directions(weather, rays), light


def _robust(design: Array, target: Array, most: Array, light: Array) -> Array:
    """Coefficients (5, 3) by least squares, again with less weight on what fits badly: it mirrors, or is another
    point; and with ``most`` times coefficients drawn down to ``light`` where it is more."""
    weight, over = np.ones(len(design)), np.zeros(light.shape, bool)
    coefficients = np.zeros((design.shape[1], 3))
    for _ in range(ROUNDS):
        scaled = design * weight[:, None]
        normal = scaled.T @ design
        normal += (RIDGE * np.trace(normal) / len(normal) + LEAST**2) * np.eye(len(normal))
        strength = DARKER * weight.mean() * len(design) / len(most)
        for channel in range(3):
            rows, bound = most[over[:, channel]], light[over[:, channel], channel]
            coefficients[:, channel] = np.linalg.solve(
                normal + strength * rows.T @ rows, scaled.T @ target[:, channel] + strength * rows.T @ bound
            )
        miss = np.abs(design @ coefficients - target).mean(1)
        weight = 1 / np.maximum(miss, np.median(miss) + LEAST)
        over = most @ coefficients > light
    return coefficients
