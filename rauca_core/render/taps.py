"""Taps: the linear operator that carries texels to the pixels of one view."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as save_arrays

from ..contract import Camera, RaucaError, Vehicle
from ..contract.files import write_bytes
from ..runtime.kernels import njit
from .lookup import Fragments
from .merge import Rows, fill_fringe, merge_pixels
from .mipmap import Pyramid
from .raster.pattern import Pattern, filter_table
from .raster.rasterize import Raster, rasterize
from .sparse import SparseOperator, compose
from .thin import Thinning

TAP_FORMAT = 5  # of the file and of what is computed: a change of either makes old files, and checkpoints, stale
UNIT = 65535


@dataclass(eq=False)
class Taps:
    """What one camera sees of the paint.

    ``rows(pyramid_texels)`` is the *coverage-normalized* texture x_bar of each listed pixel: its rows sum to 1.
    ``alpha * x_bar`` is the premultiplied paint layer, whose rows sum to alpha.

    Pixels of alpha below 1 / samples^2, down to 0 and up to two pixels off the paint, carry the texture of their
    painted neighbors (see `merge.fill_fringe`): the frame's light maps may show paint there that our samples missed.

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

    def save(self, path: Path, key: str = "") -> None:
        """Write one .safetensors file, atomically. ``key`` names what the taps were built from.

        Weights and coverage are 16-bit fractions; those of a row keep its sum, see :func:`quantize_rows`.
        """
        rows = self.rows
        arrays: dict[str, NDArray[Any]] = {
            "pixels": self.pixels,
            "indptr": rows.indptr,
            "columns": rows.columns,
            "weights": to_fractions(rows.weights),
            "alpha": to_fractions(self.alpha),
        }
        shape = {"width": self.width, "height": self.height, "texels": rows.shape[1], "format": TAP_FORMAT}
        metadata = {name: str(value) for name, value in shape.items()}
        write_bytes(path, save_arrays(arrays, metadata | {"key": key, "checksum": _checksum(arrays)}))

    @staticmethod
    def load(path: Path, key: str = "") -> Taps:
        """Read what :meth:`save` wrote, through a memory map.

        Raises:
            RaucaError: missing, damaged, of another format version, or of another ``key``.
        """
        if not path.is_file():
            raise RaucaError(f"{path}: not readable as taps (there is no such file); remove it")
        try:
            with safe_open(path, framework="np") as archive:
                metadata = archive.metadata() or {}
                arrays = {name: archive.get_tensor(name) for name in archive.keys()}  # noqa: SIM118 (not a dict)
        except (OSError, SafetensorError, ValueError, TypeError, KeyError, MemoryError) as error:
            raise RaucaError(f"{path}: not readable as taps ({error}); remove the file") from None
        if metadata.get("format") != str(TAP_FORMAT) or metadata.get("key") != key:
            raise RaucaError(f"{path}: taps of another view or another version of rauca; remove the file")
        if metadata.get("checksum") != _checksum(arrays):
            raise RaucaError(f"{path}: damaged taps; remove the file")
        try:
            width, height, texels = (int(metadata[name]) for name in ("width", "height", "texels"))
            pixels, indptr, columns = (arrays[name] for name in ("pixels", "indptr", "columns"))
            alpha, weights = from_fractions(arrays["alpha"]), from_fractions(arrays["weights"])
            kinds = [array.dtype for array in (pixels, indptr, columns, alpha, weights)]
            inside = (
                kinds == [np.int32, np.int64, np.int32, np.float32, np.float32]
                and 0 <= min(width, height, texels) <= max(width, height, texels) < 2**31
                and pixels.shape == alpha.shape == (len(indptr) - 1,)
                and columns.shape == weights.shape == (indptr[-1],)
                and indptr[0] == 0
                and bool((np.diff(indptr) >= 0).all() and (np.diff(pixels) > 0).all())
                and _within(pixels, width * height)
                and _within(columns, texels)
            )
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise RaucaError(f"{path}: damaged taps ({error}); remove the file") from None
        if not inside:  # kernels read without bounds checks
            raise RaucaError(f"{path}: damaged taps; remove the file")
        return Taps(width, height, pixels, alpha, SparseOperator(indptr, columns, weights, texels))


def _within(places: NDArray[np.int32], count: int) -> bool:
    return bool(places.min(initial=0) >= 0 and places.max(initial=-1) < count)


def _checksum(arrays: dict[str, NDArray[Any]]) -> str:
    total = 0
    for name in sorted(arrays):
        total = zlib.crc32(arrays[name].data, total)
    return f"{total:08x}"


def filter_view(
    vehicle: Vehicle,
    camera: Camera,
    pyramid: Pyramid,
    look: Callable[[Raster], Fragments],
    rule: Pattern,
    filter: str,
    thinning: float = 0.0,
) -> Taps:
    """The taps of one view whose samples, placed by ``rule``, read what ``look`` says.

    Pixels of less coverage than one sample take their neighbors' texture, see `merge.fill_fringe`. Weights and coverage
    are rounded as in a file, so that taps from the cache are the same to the bit.
    """
    table, reach = filter_table(filter, rule)
    raster = rasterize(vehicle.positions, vehicle.triangles, camera, margin=reach, pattern=rule)
    found = look(raster)
    price = Thinning.of(pyramid.tree, thinning)
    rows = merge_pixels(found, raster, camera, table, price)
    rows = fill_fringe(rows, camera, 1.0 / rule.number, found.columns, price)
    if found.inner is not None:
        through = SparseOperator(rows.indptr, rows.columns, rows.values.astype(np.float32), found.columns)
        read = compose(through, found.inner)
        rows = Rows(rows.pixels, rows.alpha, read.indptr, read.columns, read.weights.astype(np.float64))
    weights = from_fractions(quantize_rows(rows.indptr, rows.values))
    operator = SparseOperator(rows.indptr, rows.columns, weights, pyramid.count)
    return Taps(camera.width, camera.height, rows.pixels, from_fractions(to_fractions(rows.alpha)), operator)


def to_fractions(values: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Round values in [0, 1] to 65535ths."""
    return np.rint(values * np.float32(UNIT)).astype(np.uint16)


def from_fractions(fractions: NDArray[np.uint16]) -> NDArray[np.float32]:
    """65535ths to float32, from which :func:`to_fractions` returns to the same fractions."""
    return fractions / np.float32(UNIT)


@njit(cache=True, nogil=True)
def quantize_rows(indptr: Any, values: Any) -> Any:
    """Round rows to uint16 that sum to what the row does: rounding errors are carried along the row, none is lost."""
    result = np.empty(values.shape[0], np.uint16)
    for row in range(indptr.shape[0] - 1):
        exact, given = 0.0, 0
        for k in range(indptr[row], indptr[row + 1]):
            exact += values[k] * UNIT
            result[k] = max(int(np.rint(exact)) - given, 0)
            given += result[k]
    return result
