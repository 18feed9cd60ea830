"""Blender objects, of a file or of the open scene, into the contract's vehicle: mesh, paint, UV atlas, place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, geometry
from . import vehicle_paint
from .blocks import values_of
from .uvs import unwrapped, uv_verdict
from .vehicle import NAME_KEY, untouched_shipped
from .vehicle_arrays import SHAPES, Soup, read_objects
from .vehicle_request import TURNS, VehicleRequest, orient

DEFAULT_ATLAS = 1024


def read_vehicle(objects: list[bpy.types.Object], request: VehicleRequest) -> contract.Vehicle:
    """The vehicle that objects make up; what was assumed about axes, paint and UVs is told in its ``notes``.

    A shipped vehicle in the scene that nobody changed is that vehicle, whatever its place.

    Raises:
        RaucaError: no faces, NaN vertices, implausible size, or no telling what is paint.
    """
    if shipped := untouched_shipped(objects, request):
        return shipped
    return Reading.of(objects, request).vehicle()


@dataclass
class Reading:
    """Objects as triangles in the vehicle's frame, and which of them are paint.

    Attributes:
        request: what was asked for.
        soup: the triangles; UVs as they are in the objects.
        paint: (F,) True on paint.
        base: the paint's texture, (H, W, 3) sRGB, where it belongs to the UVs that were read.
        mask: (H, H) the paint mask that was given, or None.
        notes: what was assumed.
    """

    request: VehicleRequest
    soup: Soup
    paint: NDArray[np.bool_]
    base: NDArray[np.uint8] | None
    mask: NDArray[np.uint8] | None
    notes: list[str]

    @staticmethod
    def of(objects: list[bpy.types.Object], request: VehicleRequest) -> Reading:
        """Read objects of the present scene; raises as :func:`read_vehicle`."""
        soup = read_objects(objects)
        if len(soup.triangles) == 0:
            raise contract.RaucaError(f"{request.where}: has no faces that renders show; unhide or export its geometry")
        bad = int((~np.isfinite(soup.positions)).any(axis=1).sum())
        if bad:
            raise contract.RaucaError(f"{request.where}: {bad} vertices are NaN or infinite; repair the mesh")
        notes = orient(soup, request)
        if np.abs(soup.positions).max() > contract.MAX_EXTENT_M:  # farther, xatlas can turn for ever
            raise contract.RaucaError(f"{request.where}: reaches beyond {contract.MAX_EXTENT_M:g} m; repair the mesh")
        paint, base, mask = _choose_paint(soup, request, notes)
        if layers := {repr(piece.layer) for piece in soup.painted(paint) if piece.layers > 1}:
            notes.append(f"UVs: layer {', '.join(sorted(layers))}, of several")
        return Reading(request, soup, paint, base, mask, notes)

    def vehicle(self) -> contract.Vehicle:
        """The vehicle, its paint unwrapped anew if its UVs cannot be used."""
        fault, wrapped = uv_verdict(self.soup.uvs[self.paint])
        if fault and self.mask is not None:
            text = f"its UVs cannot be used ({fault}); give --paint-material instead"
            raise contract.RaucaError(f"--paint-mask {self.request.paint_mask}: {text}")
        vehicle = self.with_uvs(wrapped, keep_textures=not fault)
        if fault:
            vehicle, how = unwrapped(vehicle)
            vehicle = replace(vehicle, notes=[*vehicle.notes, f"UVs: {fault}; unwrapped anew{how}"])
        vehicle.check(self.request.where)
        return vehicle

    def with_uvs(self, painted: NDArray[np.float32], keep_textures: bool) -> contract.Vehicle:
        """The vehicle with UVs (F_paint, 3, 2) on its paint."""
        soup, base = self.soup, self.base if keep_textures else None
        uvs = np.nan_to_num(soup.uvs, nan=0.0, posinf=0.0, neginf=0.0)
        uvs[self.paint] = painted
        materials, material = self._materials(base)
        mask = self.mask
        if mask is None:
            height, width = self.base.shape[:2] if self.base is not None else (0, -1)
            mask = geometry.chart_mask(painted, height if height == width else DEFAULT_ATLAS)
        return contract.Vehicle(
            name=self.request.name,
            positions=soup.positions.astype(np.float32),
            triangles=soup.triangles,
            uvs=uvs.astype(np.float32),
            normals=soup.normals,
            material=material,
            materials=materials,
            paint_mask=mask,
            base_texture=base,
            source=(self.request.file or Path(bpy.data.filepath)).name,
            notes=self.notes,
        )

    def _materials(self, base: NDArray[np.uint8] | None) -> tuple[list[contract.Material], NDArray[np.int16]]:
        """Contract materials, and the material of each face: a material with both kinds of face appears twice."""
        soup, paint = self.soup, self.paint
        materials: list[contract.Material] = []
        index = np.zeros(len(paint), np.int16)
        painted_names = {soup.names[i] for i in np.unique(soup.material[paint])}
        main = vehicle_paint.linked_image(soup.blocks[soup.names[soup.material[paint][0]]])
        for number, name in enumerate(soup.names):
            block = soup.blocks[name]
            texture = vehicle_paint.base_image(block, self.request.beside)
            textured = base is not None and texture is not None and vehicle_paint.linked_image(block) == main
            for is_paint in (True, False):
                here = (soup.material == number) & (paint == is_paint)
                if here.any():
                    index[here] = len(materials)
                    spec = vehicle_paint.describe(name, block, is_paint, texture)
                    if not is_paint and name in painted_names:
                        spec = replace(spec, name=f"{spec.name} (unpainted)")
                    materials.append(replace(spec, textured=textured))
        return materials, index


def _choose_paint(
    soup: Soup, request: VehicleRequest, notes: list[str]
) -> tuple[NDArray[np.bool_], NDArray[np.uint8] | None, NDArray[np.uint8] | None]:
    """Which faces are paint, their base texture, and the mask that was given."""
    named = request.paint_material is not None or request.paint_mask is not None
    by_marks = request.by_marks if request.by_marks is not None else not named and bool(soup.marked.any())
    if by_marks:
        if not soup.marked.any():
            raise contract.RaucaError(f"{request.where}: no face is marked as paint; {request.remedy}")
        notes.append(f"paint: the {int(soup.marked.sum())} triangles marked by hand")
        return soup.marked.copy(), _base_of(soup, soup.marked, request), None
    shown = [soup.names[i] for i in np.unique(soup.material)]  # a slot that no face uses decides nothing
    painted = vehicle_paint.choose_paint(shown, request)
    paint = np.isin(np.array(soup.names)[soup.material], painted)
    base = vehicle_paint.base_image(soup.blocks[painted[0]], request.beside)
    mask = None
    if request.paint_mask is not None:
        mask = vehicle_paint.read_mask(request.paint_mask, base)
        paint &= _under_mask(soup.uvs, mask)
        if not paint.any():
            text = f"--paint-mask {request.paint_mask}: is white nowhere on the vehicle's UVs; check them"
            raise contract.RaucaError(text)
    elif request.paint_material is None:
        notes.append(f"paint: material {painted[0]!r}, by its name")
    return paint, _base_of(soup, paint, request) if mask is None else base, mask


def _base_of(soup: Soup, paint: NDArray[np.bool_], request: VehicleRequest) -> NDArray[np.uint8] | None:
    """The paint's texture, unless the UVs that were read are another layer than the one it is shown with."""
    if any(piece.layer is not None and not piece.shows_layer for piece in soup.painted(paint)):
        return None
    return vehicle_paint.base_image(soup.blocks[soup.names[soup.material[paint][0]]], request.beside)


def _under_mask(uvs: NDArray[np.float32], mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(F,) True on faces with a texel center, or their own middle, on the white of the mask."""
    size = len(mask)
    clean = np.nan_to_num(uvs, nan=0.0, posinf=0.0, neginf=0.0)
    clean = clean - np.floor(clean.min(axis=1, keepdims=True) + 1e-4)
    texels, faces = geometry.covered(clean, size, conservative=False)
    found = np.zeros(len(uvs), np.bool_)
    found[faces[mask.ravel()[texels] >= 128]] = True
    column, row = (np.clip(v * size, 0, size - 1).astype(int) for v in (clean.mean(1)[:, 0], 1 - clean.mean(1)[:, 1]))
    return found | (mask[row, column] >= 128)


HALF_HEIGHT_M = 0.75  # of the middle of no vehicle in particular


@dataclass(frozen=True, eq=False)
class Anchor:
    """What the cameras stand around.

    Attributes:
        vehicle_to_world: (4, 4) rigid transform; front along +x, wheels on z = 0.
        center: (3,) the middle of the vehicle's box, in its frame, metres.
        found: False when there is no vehicle in the scene and the world's origin stands in for it.
    """

    vehicle_to_world: NDArray[np.float64]
    center: NDArray[np.float64]
    found: bool = True


NOWHERE = Anchor(np.eye(4), np.array([0.0, 0.0, HALF_HEIGHT_M]), found=False)


def find_anchor(objects: Sequence[bpy.types.Object], request: VehicleRequest) -> Anchor:
    """The anchor of a vehicle made of ``objects``, which renders show, as :func:`read_vehicle` places it."""
    shaped = [thing for thing in objects if thing.type in SHAPES]
    if not shaped:
        return NOWHERE
    meshes = [thing for thing in shaped if thing.type == "MESH"]
    if len(meshes) == 1 and NAME_KEY in meshes[0] and not request.own_paint and not meshes[0].modifiers:
        local = _vertices(meshes[0])
        matrix = np.array(meshes[0].matrix_world)
        if len(local) and np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-4):
            return Anchor(matrix, (local.min(axis=0) + local.max(axis=0)) / 2)
    placed = [
        _vertices(thing) @ np.array(thing.matrix_world)[:3, :3].T + thing.matrix_world.translation for thing in shaped
    ]
    points = np.concatenate(placed)
    if not len(points):
        return NOWHERE
    low, high = points.min(axis=0), points.max(axis=0)
    length, width, height = high - low
    front = request.front if request.front != "AUTO" else "-Y" if width > length else "+X"
    pose = np.eye(4)
    pose[:3, :3] = TURNS[front].T
    pose[:3, 3] = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2])
    return Anchor(pose, np.array([0.0, 0.0, height / 2]))


def _vertices(thing: bpy.types.Object) -> NDArray[np.float64]:
    """Vertices of an object's evaluated mesh, (N, 3) in its own frame; the corners of its box for other shapes."""
    evaluated = thing.evaluated_get(bpy.context.view_layer.depsgraph)
    if thing.type != "MESH" or thing.mode == "EDIT":
        return np.array(evaluated.bound_box, float).reshape(-1, 3)
    return values_of(evaluated.data.vertices, "co", np.float32, 3).astype(np.float64)
