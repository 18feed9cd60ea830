"""Taps: the linear operator that carries texels to the pixels of one view."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Camera, RaucaError, Vehicle
from ..contract.files import write_bytes
from ..contract.vehicle import load_arrays
from .filters import filter_table
from .fragments import find_fragments
from .merge import fill_fringe, merge_pixels
from .pattern import pattern as subsample_pattern
from .pyramid import Pyramid
from .rasterise import rasterize
from .sparse import SparseOperator

FORMAT = 2
_ARRAYS = ("header", "pixels", "alpha", "indptr", "columns", "weights")


@dataclass(eq=False)
class Taps:
    """What one camera sees of the paint.

    ``rows(pyramid_texels)`` is the *coverage-normalised* texture x_bar of each listed pixel: its rows sum to 1.
    ``alpha * x_bar`` is the premultiplied paint layer, whose rows sum to alpha.

    Pixels of alpha below 1 / samples^2, down to 0 and up to two pixels off the paint, carry the texture of their
    painted neighbours (see `merge.fill_fringe`): the frame's light maps may show paint there that our samples missed.

    Attributes:
        width, height: of the image, pixels.
        pixels: (R,) int32 ``row * width + column``, ascending.
        alpha: (R,) float32 paint coverage in [0, 1]: pixel filter times visibility times paint mask.
        rows: the operator, from the pyramid's T texels to R pixels.
    """

    width: int
    height: int
    pixels: NDArray[np.int32]
    alpha: NDArray[np.float32]
    rows: SparseOperator

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def nbytes(self) -> int:
        arrays = (self.pixels, self.alpha, self.rows.indptr, self.rows.columns, self.rows.weights)
        return sum(a.nbytes for a in arrays)

    def coverage(self) -> NDArray[np.float32]:
        """Alpha as an image (height, width)."""
        image = np.zeros(self.height * self.width, np.float32)
        image[self.pixels] = self.alpha
        return image.reshape(self.height, self.width)

    def to_image(self, colours: Tensor, background: Tensor) -> Tensor:
        """Colours (R, 3) of the listed pixels put over a background (3, height, width)."""
        flat = background.reshape(3, -1)
        index = torch.from_numpy(self.pixels.astype(np.int64)).to(colours.device)
        return flat.index_copy(1, index, colours.T).reshape(3, self.height, self.width)

    def save(self, path: Path) -> None:
        """Write one .npz, atomically."""
        stream = io.BytesIO()
        header = np.array([FORMAT, self.width, self.height, self.rows.shape[1]], np.int64)
        arrays = (header, self.pixels, self.alpha, self.rows.indptr, self.rows.columns, self.rows.weights)
        np.savez_compressed(stream, **dict(zip(_ARRAYS, arrays, strict=True)))  # type: ignore[arg-type]
        write_bytes(path, stream.getvalue())

    @staticmethod
    def load(path: Path) -> Taps:
        """Read what :meth:`save` wrote.

        Raises:
            RaucaError: missing, damaged, or of another format version.
        """
        arrays = load_arrays(path, _ARRAYS)
        header, pixels, indptr, columns = (arrays[k] for k in ("header", "pixels", "indptr", "columns"))
        if header.shape != (4,) or header[0] != FORMAT:
            raise RaucaError(f"{path}: taps of another version of rauca; remove the file")
        width, height, texels = (int(n) for n in header[1:])
        sound = (
            len(indptr) == len(pixels) + 1 == len(arrays["alpha"]) + 1
            and indptr[0] == 0
            and indptr[-1] == len(columns) == len(arrays["weights"])
            and (np.diff(indptr) >= 0).all()
            and _within(columns, texels)
            and _within(pixels, width * height)
        )
        if not sound:  # numba reads without bounds checks: nothing may point outside
            raise RaucaError(f"{path}: damaged taps; remove the file")
        return Taps(width, height, pixels, arrays["alpha"], SparseOperator(indptr, columns, arrays["weights"], texels))


def build_taps(
    vehicle: Vehicle,
    camera_in_vehicle: Camera,
    size: int,
    samples: int = 4,
    filter: str = "blackman-harris",
    pyramid: Pyramid | None = None,
    pattern: str = "lattice",
) -> Taps:
    """Compute the taps of one view.

    All faces hide what lies behind them; only paint faces give taps.

    Args:
        vehicle: with its paint mask.
        camera_in_vehicle: the camera in the vehicle's own frame, see ``Frame.camera_in_vehicle``.
        size: side of the UV map, texels.
        samples: a pixel has ``samples`` x ``samples`` subsamples.
        filter: the pixel filter of the renderer that made the frame, one of ``filters.FILTERS``.
        pyramid: the vehicle's at ``size``, when at hand; built otherwise.
        pattern: how the subsamples lie, one of ``pattern.PATTERNS``.

    Raises:
        RaucaError: unknown filter or pattern, too many samples, nothing paintable at this size.
    """
    pyramid = pyramid or Pyramid.of(vehicle, size)
    subsamples = subsample_pattern(samples, pattern)
    table, reach = filter_table(filter, subsamples)
    raster = rasterize(vehicle.positions, vehicle.triangles, camera_in_vehicle, margin=reach, pattern=subsamples)
    found = find_fragments(vehicle, raster, pyramid)
    width, height = camera_in_vehicle.width, camera_in_vehicle.height
    place = (raster.x0, raster.y0, subsamples.columns, subsamples.rows, reach, width, height)
    rows = merge_pixels(found.index, found.texels, found.weights, found.paint, place, table, reach, pyramid.count)
    pixels, alpha, indptr, columns, weights = fill_fringe(rows, (width, height), 1.0 / samples**2, pyramid.count)
    operator = SparseOperator(indptr, columns, weights.astype(np.float32), pyramid.count)
    return Taps(width, height, pixels, alpha, operator)


def _within(values: NDArray[np.int32], limit: int) -> bool:
    return not len(values) or bool(values.min() >= 0 and values.max() < limit)
