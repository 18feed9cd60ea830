"""Light as a texture: what arrives at the paint in one place and weather, the same for every camera.

The paint's base is diffuse under layers without color (`blender_addon/scene/paint.py`). Its gain in a pixel is
``A = coverage * T * c * (taps @ E)``: E an irradiance texture of the vehicle, T the fog's transmittance and c the share
that the finish lets out towards the camera, both known. E is found by least squares through the taps from the light
maps of all views of a place: noise of single views averages away, and edges are as sharp as the taps.

What the model leaves out is told as residuals: what a lacquer mirrors of the paint's own light, fog that scatters light
back into the ray, bounces beyond diffuse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
import torch
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg
from scipy.spatial import cKDTree
from torch import Tensor

from ..contract import Camera, RaucaError, Vehicle, Weather, finish_of
from ..contract.color import linear_to_srgb
from ..contract.irradiance import Residual
from ..render import Taps
from .air import transmittance
from .paint_optics import PaintOptics
from .paint_surface import PaintSurface, as_matrix

Array = NDArray[np.float64]

SOLID = 0.98  # coverage from which a pixel is no edge: others tell nothing of the light that the taps do not
MID = 0.5  # albedo whose display value errors are measured in
SEEN = 1e-3  # solid pixels: a texel that told this much of them is seen; a far pixel shares itself among hundreds
KNOWN = 0.9  # share of a pixel's texels that some source saw, from which the texture is trusted there
NEIGHBORS = 8  # seen texels, nearest in place and direction, that tell the light of one unseen
METRES_PER_TURN = 1.0  # how far apart two texels of opposite directions count, halved
# How a texture is fitted, as measured (`docs/environment.md`).
SMOOTHNESS = 0.1  # weight of differences between neighbors against errors of pixels, both in display values
EDGE = 0.05  # relative difference from which neighbors are taken for a shadow's edge and pay less
SPOT = 0.04  # error in display values from which a pixel counts less and less
ROUNDS = 4  # times that both are weighed anew
STEPS = 40  # of conjugate gradients a round


@dataclass(frozen=True, eq=False)
class Source:
    """One view of the place, its exposure and its rain taken out.

    Attributes:
        camera: in the vehicle's frame.
        taps: of that camera.
        A: (R, 3) linear gain at the taps' pixels, coverage included, as `exact.Light.A` but for exposure and rain.
        B: (R, 3) linear light beside the paint's, likewise. Where it alone is display white, no paint is seen, and A,
            what is left of a great difference, is noise.
        exposure_stops: of the frame, by which its errors are weighed.
        name: for the report.
        shown: (R,) share of each pixel that shows paint behind what stands before the vehicle; None if nothing does.
    """

    camera: Camera
    taps: Taps
    A: NDArray[np.floating]
    B: NDArray[np.floating]
    exposure_stops: float = 0.0
    name: str = ""
    shown: NDArray[np.floating] | None = None

    def solid(self) -> NDArray[np.bool_]:
        """(R,) True in pixels wholly of paint, with nothing before it and no glare on it."""
        whole = (self.taps.alpha >= SOLID) & (self.B.max(1, initial=0.0) * 2.0**self.exposure_stops < 1.0)
        return whole if self.shown is None else whole & (self.shown >= SOLID)


@dataclass(frozen=True, eq=False)
class Irradiance:
    """The light on a vehicle in one place and weather, for taps of one map size.

    Attributes:
        surface: of the vehicle's paint.
        optics: of its finish.
        weather: of which fog and water matter.
        texels: (P, 3) float32 linear, radiance of white paint seen head-on without lacquer, in exposure 0.
        weight: (P,) float32, how many solid pixels of the sources told it; 0 where none did.
        residuals: of the sources.
    """

    surface: PaintSurface
    optics: PaintOptics
    weather: Weather
    texels: NDArray[np.float32]
    weight: NDArray[np.float32]
    residuals: tuple[Residual, ...] = ()

    def gain(self, taps: Taps, camera_in_vehicle: Camera, exposure_stops: float = 0.0) -> Tensor:
        """The light map A at the taps' pixels, (R, 3) float32 linear: coverage, fog, finish and exposure included.

        Args:
            taps: of the camera, on ``surface.pyramid``.
            exposure_stops: see `Frame.exposure_stops`.
        """
        share = torch.from_numpy(taps.alpha * np.float32(2.0**exposure_stops))
        return self.gain_of_paint(taps, camera_in_vehicle) * share[:, None]

    def gain_of_paint(self, taps: Taps, camera_in_vehicle: Camera) -> Tensor:
        """:meth:`gain` per paint coverage and in exposure 0, (R, 3) float32 linear; also off the paint, as taps are."""
        left = let_out(taps, camera_in_vehicle, self.surface, self.optics, self.weather)
        return taps.rows(self._levels) * torch.from_numpy(left.astype(np.float32))[:, None]

    def on(self, surface: PaintSurface) -> Irradiance:
        """The same light for taps of another map size; ``surface`` has light textures of the same size."""
        return replace(self, surface=surface)

    def known(self, taps: Taps) -> Tensor:
        """Share (R,) in [0, 1] of what each pixel reads that some source saw; the rest is filled."""
        return taps.rows(self._known)[:, 0]

    @property
    def seen(self) -> float:
        """Share of the texels that some source saw."""
        return float((self.weight >= SEEN).mean())

    @property
    def nbytes(self) -> int:
        """Of memory, once a view was lit."""
        return self.texels.nbytes + self.weight.nbytes + 3 * 4 * len(self.surface.positions)

    @cached_property
    def _levels(self) -> Tensor:
        return self.surface.levels(torch.from_numpy(self.texels))

    @cached_property
    def _known(self) -> Tensor:
        seen = (self.weight >= SEEN).astype(np.float32)
        return self.surface.levels(torch.from_numpy(np.repeat(seen[:, None], 3, 1)))


def optics_of(vehicle: Vehicle, finish: str, weather: Weather) -> PaintOptics:
    """The optics of a vehicle's paint in a finish of :data:`contract.plan.FINISHES` and a weather's water.

    Of several paint materials with finishes of their own, the one with the most faces.
    """
    faces = np.bincount(vehicle.material[vehicle.paint_faces()], minlength=len(vehicle.materials))
    return PaintOptics(finish_of(vehicle.materials[int(faces.argmax())], finish), weather.film)


def view_factor(taps: Taps, camera: Camera, surface: PaintSurface, optics: PaintOptics, weather: Weather) -> Array:
    """Share (R,) of a texel's light that each pixel gets: coverage, fog between and the finish's angular factor."""
    return taps.alpha * let_out(taps, camera, surface, optics, weather)


def let_out(taps: Taps, camera: Camera, surface: PaintSurface, optics: PaintOptics, weather: Weather) -> Array:
    """Share (R,) of a texel's light that comes from its paint to the camera: :func:`view_factor` but for coverage."""
    with torch.no_grad():
        places, normals = (taps.rows(t).numpy().astype(np.float64) for t in (surface.positions, surface.normals))
    towards = camera.position - places
    length = np.maximum(np.linalg.norm(towards, axis=1), 1e-6)
    size = np.maximum(np.linalg.norm(normals, axis=1), 1e-6)
    cosine = (normals * towards).sum(1) / (length * size)
    return optics(cosine, normals[:, 2] / size) * transmittance(weather, camera.position, places)


def fit_place(sources: Sequence[Source], surface: PaintSurface, optics: PaintOptics, weather: Weather) -> Irradiance:
    """The irradiance texture that explains all views of one place and weather.

    Least squares in display values, through the taps, with a prior on differences between neighbors; pixels far off and
    differences that are edges are weighed down in turns. Texels that no source saw take the mean of the eight seen ones
    nearest in place and direction.

    Raises:
        RaucaError: no source shows a pixel wholly covered by paint.
    """
    stops = float(np.median([source.exposure_stops for source in sources])) if sources else 0.0
    views = [_Equations.of(source, surface, optics, weather, stops) for source in sources]
    rows = np.concatenate([v.share for v in views]) if views else np.zeros(0)
    if not len(rows):
        raise RaucaError("irradiance: no view shows enough of the paint; give views of this place that do")
    matrix = sparse.vstack([v.matrix for v in views]).tocsr()
    wanted = np.concatenate([v.wanted for v in views])
    beside = np.concatenate([v.beside for v in views])
    texels, error = _solve(matrix, rows, wanted, beside, surface.differences)
    weight = np.asarray(matrix.sum(0)).ravel()
    texels = _fill(texels, weight >= SEEN, surface) * 2.0**-stops
    ends = np.cumsum([0] + [len(v.share) for v in views])
    residuals = tuple(
        _residual(source.name, error[a:b]) for source, a, b in zip(sources, ends[:-1], ends[1:], strict=True)
    )
    return Irradiance(surface, optics, weather, texels.astype(np.float32), weight.astype(np.float32), residuals)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Solid pixels of a view: ``share * (matrix @ E) = wanted``, shown with the light ``beside``, in one exposure."""

    matrix: sparse.csr_matrix
    share: Array
    wanted: Array
    beside: Array

    @staticmethod
    def of(source: Source, surface: PaintSurface, optics: PaintOptics, weather: Weather, stops: float) -> _Equations:
        solid = np.flatnonzero(source.solid())
        share = view_factor(source.taps, source.camera, surface, optics, weather)[solid]
        matrix = as_matrix(source.taps.rows)[solid] @ surface.matrix
        wanted, beside = (np.asarray(light, np.float64)[solid] * 2.0**stops for light in (source.A, source.B))
        return _Equations(matrix, share, wanted, beside)


def _solve(
    matrix: sparse.csr_matrix, share: Array, wanted: Array, beside: Array, differences: sparse.csr_matrix
) -> tuple[Array, Array]:
    """Texels (P, 3), and what the last round left of each equation (N, 3) in display values."""
    columns = matrix.shape[1]
    level = float(max(np.median(wanted.mean(1) / np.maximum(share, 1e-3)), 1e-6))
    texels = np.full((columns, 3), level)
    squares, edges = matrix.power(2).T.tocsr(), abs(differences).T.tocsr()
    matrix_t, differences_t = matrix.T.tocsr(), differences.T.tocsr()
    for turn in range(ROUNDS):
        seen = share[:, None] * (matrix @ texels)
        slope = _display_slope((MID * np.maximum(seen, wanted) + beside).mean(1))
        error = np.abs(_display(seen, beside) - _display(wanted, beside)).max(1)
        trust = np.ones(len(share)) if turn == 0 else 1 / np.maximum(1, error / SPOT)
        step = np.abs(differences @ texels).mean(1) / level
        smooth = SMOOTHNESS / np.sqrt(1 + (step / EDGE) ** 2) * _display_slope(np.array(MID * level)) ** 2
        weigh = trust * (slope * share) ** 2

        def normal(x: Array, weigh: Array = weigh, smooth: Array = smooth) -> Array:
            image = x.reshape(columns, 3)
            data = matrix_t @ (weigh[:, None] * (matrix @ image))
            return (data + differences_t @ (smooth[:, None] * (differences @ image)) + 1e-9 * image).ravel()

        right = matrix_t @ ((trust * slope**2 * share)[:, None] * wanted)
        diagonal = np.repeat(squares @ weigh + edges @ smooth + 1e-9, 3)
        system = LinearOperator((3 * columns, 3 * columns), normal)
        jacobi = LinearOperator(system.shape, lambda x, d=diagonal: x / d)
        solved, _ = cg(system, right.ravel(), texels.ravel(), maxiter=STEPS, rtol=1e-4, M=jacobi)
        texels = np.maximum(solved.reshape(columns, 3), 0.0)
    return texels, _display(share[:, None] * (matrix @ texels), beside) - _display(wanted, beside)


def _display(gain: Array, beside: Array) -> Array:
    return np.asarray(linear_to_srgb(np.clip(gain * MID + beside, 0, 1)), np.float64)


def _display_slope(shown: Array) -> Array:
    """Change of display values with the gain where ``shown`` light is seen, above the straight part of the curve."""
    return 1.055 / 2.4 * MID * np.clip(shown, 1e-3, 1) ** (1 / 2.4 - 1)


def _fill(texels: Array, seen: NDArray[np.bool_], surface: PaintSurface) -> Array:
    if seen.all() or not seen.any():
        return texels
    points = np.concatenate([surface.texel_positions, METRES_PER_TURN * surface.texel_normals], 1)
    _, near = cKDTree(points[seen]).query(points[~seen], k=min(NEIGHBORS, int(seen.sum())))
    filled = texels.copy()
    filled[~seen] = texels[seen][near.reshape(len(points) - int(seen.sum()), -1)].mean(1)
    return filled


def held_out(irradiance: Irradiance, source: Source) -> Residual:
    """How well a texture predicts a view that it was not fitted to, where its sources saw the paint."""
    told = (irradiance.known(source.taps).numpy() >= KNOWN) & source.solid()
    scale = 2.0**source.exposure_stops
    predicted = irradiance.gain(source.taps, source.camera).numpy()[told] * scale
    wanted, beside = (np.asarray(light)[told] * scale for light in (source.A, source.B))
    return _residual(source.name, _display(predicted, beside) - _display(wanted, beside))


def _residual(name: str, error: Array) -> Residual:
    far = float((np.abs(error).max(1) > 2 * SPOT).mean()) if len(error) else 0.0
    mean = float((error**2).mean()) if len(error) else 0.0
    return Residual(name, len(error), float(-10 * np.log10(max(mean, 1e-12))), far)
