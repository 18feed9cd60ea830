"""Irradiance textures of a data set on disk: the light on the vehicle in one place and weather.

Folder ``irradiance/L00-clear-day/`` of a data set::

    irradiance.json    this module
    texels.npz         texels (P, 3) float16 linear, the radiance of white paint without lacquer and fog, in exposure 0;
                       weight (P,) float16, how many solid pixels of the sources told it, 0 where filled
    SHA256SUMS         of both

The P texels are those of the vehicle's UV map at ``size`` that paint covers, row by row from the top.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .files import atomic_folder, file_digest, read_sums, write_bytes, write_json, write_sums
from .schema import Record, read_json
from .vehicle import load_arrays

LARGEST_HALF = 65504.0


@dataclass(frozen=True)
class Residual(Record):
    """How well the texture explains a source, at pixels wholly of paint.

    Attributes:
        frame: its id.
        pixels: how many there are.
        display_db: PSNR of sRGB values of an albedo of one half, dB.
        spots: share of pixels too far off to be believed: mirror images, lamps, glass before paint, noise.
    """

    frame: str
    pixels: int
    display_db: float
    spots: Annotated[float, (0, 1)]


@dataclass(frozen=True)
class StoredLight(Record):
    """What is told of an irradiance texture.

    Attributes:
        location, weather: the place's index in its data set and the weather's name.
        atlas_id, size: the UV layout, and the side of the map in texels.
        finish: of the paint, one of ``plan.FINISHES``.
        seen, unseen: share of the texels that some source saw; how many none did, which are filled with the mean of
            the eight seen ones nearest in place and direction.
        held_out_db: PSNR as of a residual, of a source that a fit without it predicts; None of a lone source.
        sources: residuals of all of them.
    """

    FORMAT = ("rauca-irradiance", 3)
    location: int
    weather: str
    atlas_id: str
    size: Annotated[int, (1, 8192)]
    finish: str
    seen: Annotated[float, (0, 1)]
    unseen: Annotated[int, (0, 8192**2)]
    held_out_db: float | None
    sources: tuple[Residual, ...]


def irradiance_folder(dataset: Path, location: int, weather: str) -> Path:
    """Where a data set keeps the light of a place and weather."""
    return Path(dataset) / "irradiance" / f"L{location:02d}-{weather}"


def save_irradiance(
    folder: Path, light: StoredLight, texels: NDArray[np.floating], weight: NDArray[np.floating]
) -> None:
    """Write the folder in one atomic rename; ``texels`` (P, 3) linear, ``weight`` (P,)."""
    arrays = io.BytesIO()
    halves = {
        name: np.clip(a, 0, LARGEST_HALF).astype(np.float16) for name, a in (("texels", texels), ("weight", weight))
    }
    np.savez_compressed(arrays, **halves)
    with atomic_folder(Path(folder)) as temporary:
        write_bytes(temporary / "texels.npz", arrays.getvalue())
        write_json(temporary / "irradiance.json", light.to_json())
        write_sums(temporary, ["texels.npz", "irradiance.json"])


def load_irradiance(folder: Path) -> tuple[StoredLight, NDArray[np.float32], NDArray[np.float32]]:
    """Read what :func:`save_irradiance` wrote: texels (P, 3) and weight (P,), float32.

    Raises:
        RaucaError: missing or damaged.
    """
    folder = Path(folder)
    again = "run `rauca dataset light` again"
    sums = read_sums(folder)
    for name in ("texels.npz", "irradiance.json"):
        if not (folder / name).is_file() or sums.get(name) != file_digest(folder / name):
            raise RaucaError(f"{folder}/{name}: missing, or not what was written; remove {folder} and {again}")
    light = StoredLight.from_json(read_json(folder / "irradiance.json"))
    arrays = load_arrays(folder / "texels.npz", ("texels", "weight"))
    texels, weight = arrays["texels"], arrays["weight"]
    sound = texels.dtype.kind == weight.dtype.kind == "f" and texels.shape == (*weight.shape, 3) and weight.ndim == 1
    if not sound or not (np.isfinite(texels).all() and np.isfinite(weight).all()):
        raise RaucaError(f"{folder}/texels.npz: not the light of texels; remove {folder} and {again}")
    return light, texels.astype(np.float32), weight.astype(np.float32)
