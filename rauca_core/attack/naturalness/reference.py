"""What paint should look like, and how far it is from it: a UV map, a photograph laid on the vehicle, or one color."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ...contract import RaucaError, Vehicle, load_camouflage
from ...contract.color import to_bytes
from ...contract.files import file_digest
from ...render import Pyramid, linear_to_srgb, pattern_pyramid, project_pattern, srgb_to_linear
from ...runtime.images import read_image
from . import Naturalness, is_color, parse_color
from .colors import delta_e_2000, lab
from .patches import TexelPoints

PHOTO = 512  # texels across a photograph


def fingerprint(reference: str) -> str | None:
    """SHA-256 of what a reference names, None for a color; raises :class:`RaucaError` where there is no such file."""
    if is_color(reference):
        parse_color(reference, "--reference")
        return None
    image = _image_of(Path(reference))
    if not image.is_file():
        raise RaucaError(f"--reference {reference}: not found; give an image, a camouflage's .json or a color #rrggbb")
    return file_digest(image)


def reference_texels(vehicle: Vehicle, atlas: Pyramid, wanted: Naturalness) -> NDArray[np.uint8]:
    """The reference on the paintable texels of the atlas, (P, 3) 8-bit sRGB.

    A photograph is cut to a square, mirrored so that it repeats without an edge, and projected along the vehicle's
    axes.

    Raises:
        RaucaError: a missing or damaged file, another picture than the run began with, a camouflage of another atlas.
    """
    given = wanted.reference
    assert given is not None
    if is_color(given):
        color = np.array(parse_color(given, "--reference"), np.uint8)
        return np.broadcast_to(color, (len(atlas.texels), 3)).copy()
    if wanted.reference_sha256 not in (None, fingerprint(given)):
        raise RaucaError(f"--reference {given}: changed since the run began; bring the picture back, or start anew")
    path = Path(given)
    if path.suffix.lower() == ".json":
        load_camouflage(path)[0].check_fits(vehicle.atlas_id, str(path))
    image = read_image(_image_of(path))
    color_image = np.repeat(image[..., None], 3, -1) if image.ndim == 2 else image
    if path.suffix.lower() == ".json" or wanted.reference_width_m is None:
        if image.shape[0] != image.shape[1]:
            raise RaucaError(f"--reference {given}: a UV map is square, this is {image.shape[1]}x{image.shape[0]}")
        resized = Image.fromarray(color_image).resize((atlas.size, atlas.size), Image.Resampling.BOX)
        return np.asarray(resized).reshape(-1, 3)[atlas.texels]
    tiles = pattern_pyramid(2 * PHOTO)
    projection = project_pattern(vehicle, atlas, tiles, 2 * wanted.reference_width_m)
    return to_bytes(linear_to_srgb(projection(tiles(srgb_to_linear(_tile(color_image))))).numpy())


def _image_of(path: Path) -> Path:
    return load_camouflage(path)[1] if path.suffix.lower() == ".json" else path


def _tile(image: NDArray[np.uint8]) -> Tensor:
    """The square middle of an image and its mirror images, (4 * PHOTO^2, 3) sRGB."""
    side = min(image.shape[:2])
    top, left = (image.shape[0] - side) // 2, (image.shape[1] - side) // 2
    square = Image.fromarray(image).crop((left, top, left + side, top + side))
    small = np.asarray(square.resize((PHOTO, PHOTO), Image.Resampling.BOX), np.float32) / 255
    wide = np.concatenate([small, small[:, ::-1]], 1)
    return torch.from_numpy(np.concatenate([wide, wide[::-1]]).reshape(-1, 3))


@dataclass(frozen=True)
class Distance:
    """How far paint is from a reference; means are over the vehicle's surface.

    Attributes:
        mean, largest: of the CIE 1976 distance; mean_2000: of CIEDE2000.
    """

    mean: float
    largest: float
    mean_2000: float

    @staticmethod
    def of(texels: NDArray[np.uint8], reference: NDArray[np.uint8], areas: NDArray[np.float64]) -> Distance:
        """Of 8-bit sRGB texels (P, 3) from others, weighted by their areas (P,)."""
        one, other = (lab(torch.from_numpy(t / 255.0)).numpy() for t in (texels, reference))
        apart = np.linalg.norm(one - other, axis=1)
        mean, mean_2000 = (float(np.average(d, weights=areas)) for d in (apart, delta_e_2000(one, other)))
        return Distance(mean, float(apart.max()), mean_2000)


def distance_of_map(vehicle: Vehicle, uv_map: NDArray[np.uint8], wanted: Naturalness) -> Distance:
    """How far any UV map (size, size, 3) is from the reference of ``wanted``, on its paintable texels."""
    atlas = Pyramid.of(vehicle, len(uv_map))
    texels = uv_map.reshape(-1, 3)[atlas.texels]
    return Distance.of(texels, reference_texels(vehicle, atlas, wanted), TexelPoints.of(vehicle, atlas).areas)
