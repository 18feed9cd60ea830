"""Taps: the linear operator that carries texels to the pixels of one view."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as save_arrays
from torch import Tensor

from ..contract import Camera, RaucaError, Vehicle
from ..contract.files import write_bytes
from .encoding import decode, encode, from_fractions, quantize_rows, to_fractions
from .merge import Rows, fill_fringe, merge_pixels
from .mipmap import Pyramid
from .raster.pattern import Pattern, filter_table
from .raster.pattern import pattern as subsample_pattern
from .raster.rasterize import Raster, rasterize
from .sampler import Lookup, Sampler, look_up
from .sparse import SparseOperator, compose
from .thin import Thinning

TAP_FORMAT = 4  # of the file and of what is computed: a change of either makes old files, and checkpoints, stale
COARSEST = 1e-3  # thinning at one sample
THINNING = 1e-5  # from 4 x 4 subsamples up: 8 x 8 keep half their taps and 50 dB against Cycles


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

    def to_image(self, colors: Tensor, background: Tensor) -> Tensor:
        """Colors (R, 3) of the listed pixels put over a background (3, height, width)."""
        flat = background.reshape(3, -1)
        index = torch.from_numpy(self.pixels.astype(np.int64)).to(colors.device)
        return flat.index_copy(1, index, colors.T).reshape(3, self.height, self.width)

    def save(self, path: Path, key: str = "") -> None:
        """Write one .safetensors file, atomically. ``key`` names what the taps were built from."""
        rows = self.rows
        arrays: dict[str, NDArray[Any]] = {
            "places": encode(self.pixels, rows.indptr, rows.columns),
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
        if set(arrays) != {"places", "weights", "alpha"} or metadata.get("checksum") != _checksum(arrays):
            raise RaucaError(f"{path}: damaged taps; remove the file")
        width, height, texels = (_count(metadata.get(name, "")) for name in ("width", "height", "texels"))
        places = decode(arrays["places"], len(arrays["alpha"]), len(arrays["weights"]), width * height, texels)
        if min(width, height, texels) < 0 or places is None:
            raise RaucaError(f"{path}: damaged taps; remove the file")
        pixels, indptr, columns = places
        operator = SparseOperator(indptr, columns, from_fractions(arrays["weights"]), texels)
        return Taps(width, height, pixels, from_fractions(arrays["alpha"]), operator)


def _count(text: str) -> int:
    """A whole number below 2^31; -1 for anything else."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 9 else -1


def _checksum(arrays: dict[str, NDArray[Any]]) -> str:
    total = 0
    for name in sorted(arrays):
        total = zlib.crc32(arrays[name].data, total)
    return f"{total:08x}"


def build_taps(
    vehicle: Vehicle,
    camera_in_vehicle: Camera,
    size: int,
    samples: int = 4,
    filter: str = "blackman-harris",
    pyramid: Pyramid | None = None,
    pattern: str = "lattice",
    thinning: float | None = None,
    sampler: Sampler = Sampler.AREA,
) -> Taps:
    """Compute the taps of one view.

    All faces hide what lies behind them; only paint faces give taps.

    Args:
        vehicle: with its paint mask.
        camera_in_vehicle: the camera in the vehicle's own frame, see ``Frame.camera_in_vehicle``.
        size: side of the UV map, texels.
        samples: a pixel has about ``samples`` x ``samples`` subsamples.
        filter: the pixel filter of the renderer that made the frame, one of ``filters.FILTERS``.
        pyramid: the vehicle's at ``size``, when at hand; built otherwise.
        pattern: how the subsamples lie, one of ``pattern.PATTERNS``.
        thinning: squared weight error that saving one tap is worth, see `thin`; 0 keeps every tap. None takes what
            fits the samples: the fewer they are, the less their taps need to be exact.
        sampler: how a subsample reads the map: ours, or a renderer of the literature, whose taps are not thinned.

    Raises:
        RaucaError: unknown filter or pattern, too many samples, nothing paintable at this size.
    """
    pyramid = pyramid or Pyramid.of(vehicle, size)
    if sampler != Sampler.AREA:
        thinning = 0.0
    elif thinning is None:
        thinning = usual_thinning(samples)

    def look(raster: Raster) -> Lookup:
        return look_up(vehicle, raster, pyramid, sampler)

    return filter_view(vehicle, camera_in_vehicle, pyramid, look, subsample_pattern(samples, pattern), filter, thinning)


def filter_view(
    vehicle: Vehicle,
    camera: Camera,
    pyramid: Pyramid,
    look: Callable[[Raster], Lookup],
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
    rows = merge_pixels(found.fragments, raster, camera, table, found.columns, price)
    rows = fill_fringe(rows, camera, 1.0 / rule.number, found.columns, price)
    if found.inner is not None:
        through = SparseOperator(rows.indptr, rows.columns, rows.values.astype(np.float32), found.columns)
        read = compose(through, found.inner)
        rows = Rows(rows.pixels, rows.alpha, read.indptr, read.columns, read.weights.astype(np.float64))
    weights = from_fractions(quantize_rows(rows.indptr, rows.values))
    operator = SparseOperator(rows.indptr, rows.columns, weights, pyramid.count)
    return Taps(camera.width, camera.height, rows.pixels, from_fractions(to_fractions(rows.alpha)), operator)


def usual_thinning(samples: int) -> float:
    """The price of a tap that fits ``samples`` x ``samples``: its error stays below that of so few samples."""
    return min(THINNING * max(1.0, 4 / samples) ** 6, COARSEST)
