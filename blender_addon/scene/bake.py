"""The camouflage of a vehicle in the open scene, in another UV layer of its meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import bake, color, contract, files, geometry
from .blocks import values_of
from .coating import Coat, set_baked_layer
from .images import blender_pixels, float_image, image_linear
from .mesh_edits import Surface, require_own_faces, write_layer
from .uvs import BEYOND, OVERLAP_LIMIT, in_tile, shared_texels, smart_project
from .vehicle_arrays import Piece

HOMELESS_LIMIT = 0.005  # of the paint's area; slivers may have no area in a layout
POINTS = 200_000  # on the surface, where the baked picture is held against the camouflage
IMAGE_NAME = "rauca baked"


@dataclass(frozen=True, eq=False)
class Task:
    """All that a bake needs, as arrays: it may run in a thread, which must not touch Blender.

    Attributes:
        source_uvs, target_uvs: (F, 3, 2) of the paint, in [0, 1].
        wraps: the target's UVs lie in several tiles.
        material: (F,) row of ``bases``.
        bases: (M, 3) linear color below the camouflage, used where the base texture is not.
        textured: (M,) True where the base texture gives that color.
        camouflage, mask, base: linear pictures in the source's layout; ``base`` may be None.
        size: of the result, texels.
    """

    source_uvs: NDArray[np.float64]
    target_uvs: NDArray[np.float64]
    wraps: bool
    material: NDArray[np.int16]
    bases: NDArray[np.float32]
    textured: NDArray[np.bool_]
    camouflage: NDArray[np.float32]
    mask: NDArray[np.float32]
    base: NDArray[np.float32] | None
    size: int

    def color_at(self, face: NDArray[np.int64], uv: NDArray[np.float64]) -> NDArray[np.float32]:
        """The paint's linear base color (N, 3) at source UVs (N, 2), as the scene's materials mix it."""
        below = self.bases[self.material[face]]
        if self.base is not None:
            textured = self.textured[self.material[face]]
            below[textured] = bake.bilinear(self.base, uv[textured])
        share = bake.bilinear(self.mask, uv)
        return below + share * (bake.bilinear(self.camouflage, uv) - below)


@dataclass(frozen=True, eq=False)
class Baked:
    """The result, and its sRGB values held against the camouflage at points all over the paint.

    Attributes:
        png: the picture, 8-bit sRGB, as a file.
        pixels: (N, N, 4) linear float, row 0 at the bottom: as Blender keeps it.
        psnr_db: texel by texel; what a camera sees averages over texels and comes out better.
        difference: mean absolute difference, of the full range.
    """

    png: bytes
    pixels: NDArray[np.float32]
    psnr_db: float
    difference: float


def other_layers(surface: Surface) -> list[str]:
    """UV layers that all painted meshes have, but the one of the camouflage."""
    pieces = surface.painted_pieces()
    names = [{layer.name for layer in piece.owner.data.uv_layers} for piece in pieces]
    own = {piece.layer for piece in pieces}
    return [layer.name for layer in pieces[0].owner.data.uv_layers if layer.name in set.intersection(*names) - own]


def add_layer(surface: Surface) -> str:
    """Lay the paint out by Blender's Smart UV Project in a new UV layer; returns its name. Active layers stay so.

    Raises:
        RaucaError: a mesh that cannot be written to, or has no room for another layer; nothing was changed.
    """
    pieces = surface.painted_pieces()
    require_own_faces(pieces)
    full = [piece.owner.name for piece in pieces if len(piece.owner.data.uv_layers) >= 8]
    if full:
        raise contract.RaucaError(f"{full[0]}: has 8 UV layers, Blender's most; remove one")
    taken = {layer.name for piece in pieces for layer in piece.owner.data.uv_layers}
    name = next(n for n in ("baked", *(f"baked.{i:03}" for i in range(1, 100))) if n not in taken)
    uvs = np.zeros_like(surface.vehicle.uvs)
    uvs[surface.paint] = smart_project(surface.vehicle)
    for piece in pieces:
        write_layer(piece, surface.paint[piece.span], uvs[piece.span], name)
    return name


def prepare_bake(surface: Surface, coat: Coat, layer: str, size: int, allow_overlaps: bool) -> Task:
    """Gather what a bake into the UV layer ``layer`` needs.

    Raises:
        RaucaError: the layer is missing, or cannot hold the camouflage; says what would be lost and what to do.
    """
    pieces = surface.painted_pieces()
    require_own_faces(pieces)
    moved, wraps = _within(np.concatenate([_layer_uvs(surface, piece, layer) for piece in pieces]), layer)
    _require_room(surface, moved, layer)
    shared = shared_texels(moved) or 0.0
    if shared > OVERLAP_LIMIT and not allow_overlaps:
        raise contract.RaucaError(
            f"UV layer {layer!r}: {shared:.0%} of its texels lie on two parts at once, which would both lose their own "
            "camouflage; unwrap it without mirrored or stacked islands, or switch on Allow overlaps"
        )
    vehicle = surface.vehicle
    camouflage, mask = coat.image("camouflage"), coat.image("mask")
    if camouflage is None or mask is None:
        raise contract.RaucaError("The camouflage's image is gone from this file; apply the camouflage again (step 6)")
    base = vehicle.base_texture
    return Task(
        source_uvs=vehicle.uvs[surface.paint].astype(np.float64),
        target_uvs=moved,
        wraps=wraps,
        material=vehicle.material[surface.paint],
        bases=np.array([m.base_color for m in vehicle.materials], np.float32),
        textured=np.array([m.textured for m in vehicle.materials]),
        camouflage=image_linear(camouflage),
        mask=image_linear(mask)[..., :1],
        base=None if base is None else color.srgb_to_linear(base / np.float32(255)),
        size=size,
    )


def run_bake(task: Task, progress: Callable[[float], None]) -> Baked:
    """Carry the camouflage over; touches no Blender data, so it may run in a thread."""
    carried = bake.carry(task.source_uvs, task.target_uvs, task.size, task.color_at, len(task.camouflage), progress)
    srgb = color.to_bytes(color.linear_to_srgb(carried.linear))
    linear = color.srgb_to_linear(srgb / np.float32(255))
    return Baked(files.png_bytes(srgb), blender_pixels(linear), *_on_surface(task, linear))


def baked_image(baked: Baked) -> bpy.types.Image:
    """The picture as an image of this .blend, to be packed.

    It is a float image in linear light, as the camouflage is: of 8-bit ones Cycles mixes neighboring texels before it
    decodes them, which game engines do not, and which costs 3 dB on a camouflage with fine detail.
    """
    return float_image(IMAGE_NAME, baked.pixels)


def show_baked(surface: Surface, coat: Coat, layer: str, wraps: bool, image: bpy.types.Image) -> None:
    """Let the coat show ``image`` in the UV layer ``layer``; the picture of an earlier bake goes."""
    previous = coat.image("baked")
    coat.set_baked(image, wraps)
    if previous is not None and previous.users == 0:
        bpy.data.images.remove(previous)
    for piece in surface.painted_pieces():
        for material in surface.materials(piece):
            set_baked_layer(material, layer)
    coat.show("BAKED")


def _layer_uvs(surface: Surface, piece: Piece, layer: str) -> NDArray[np.float64]:
    found = piece.owner.data.uv_layers.get(layer)
    if found is None:
        raise contract.RaucaError(f"{piece.owner.name}: has no UV layer {layer!r}; all painted parts need it")
    values = values_of(found.uv, "vector", np.float32, 2)
    return values[piece.loops[surface.paint[piece.span]]].astype(np.float64)


def _within(uvs: NDArray[np.float64], layer: str) -> tuple[NDArray[np.float64], bool]:
    """The UVs moved by whole tiles into [0, 1], and whether any had to be."""
    if not np.isfinite(uvs).all():
        raise contract.RaucaError(f"UV layer {layer!r}: some of its UVs are not numbers; unwrap it again")
    moved, crossing, tile = in_tile(uvs, BEYOND)
    if crossing.any():
        raise contract.RaucaError(
            f"UV layer {layer!r}: {int(crossing.sum())} of {len(uvs)} painted triangles reach beyond the image; "
            "scale or move their islands into it in the UV editor (UV > Pack Islands)"
        )
    return moved, bool((tile != 0).any())


def _require_room(surface: Surface, uvs: NDArray[np.float64], layer: str) -> None:
    """Refuse a layout in which parts of the paint have no area."""
    _, area = geometry.face_normals(surface.soup.positions, surface.soup.triangles[surface.paint])
    homeless = np.abs(geometry.signed_uv_area(uvs)) < 5e-13
    lost = area[homeless].sum() / max(area.sum(), 1e-30)
    if lost > HOMELESS_LIMIT:
        raise contract.RaucaError(
            f"UV layer {layer!r}: {lost:.0%} of the paint has no place in it; unwrap these faces in that layer"
        )


def _on_surface(task: Task, linear: NDArray[np.float32]) -> tuple[float, float]:
    """PSNR in dB, and the mean absolute difference, of sRGB values at points spread over the source's layout."""
    area = np.abs(geometry.signed_uv_area(task.source_uvs))
    rng = np.random.default_rng(0)
    face = rng.choice(len(area), POINTS, p=area / area.sum())
    a, b = rng.random((2, POINTS))
    a, b = np.where(a + b > 1, (1 - a, 1 - b), (a, b))
    weights = np.stack([1 - a - b, a, b], axis=1)[..., None]
    wanted = task.color_at(face, (weights * task.source_uvs[face]).sum(axis=1))
    found = bake.bilinear(linear, (weights * task.target_uvs[face]).sum(axis=1))
    error = color.linear_to_srgb(found) - color.linear_to_srgb(wanted)
    squared = float(np.mean(error.astype(np.float64) ** 2))
    return float(-10 * np.log10(max(squared, 1e-10))), float(np.abs(error).mean())
