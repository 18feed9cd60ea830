"""A camouflage on the objects of a vehicle in the open scene, and off again."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import color, contract
from .camouflages import Paintwork
from .coating import PAINTED, Coat, coat_of, put_on, require_coatable, take_off
from .mesh_edits import Surface, require_own_faces, write_layer
from .paint import UV_LAYER, float_image
from .vehicle_arrays import PAINT_MARK, Piece, values_of

NAME_KEY, ATLAS_KEY = "rauca_camouflage", "rauca_atlas"  # custom properties of the coat's node group


def paint_surface(surface: Surface, paintwork: Paintwork) -> Coat:
    """Put a camouflage that fits on the objects of a vehicle; a coat that they wear is replaced.

    The objects keep their materials, slots and faces: the coat is a node group in their materials, and an attribute
    of their faces says where it lies.

    Raises:
        RaucaError: a mesh or material that cannot be changed, in words that say what to do; nothing was changed.
    """
    pieces = surface.painted_pieces()
    layers = [_existing_layer(surface, piece, span) for piece, span in pieces]
    _check(surface, pieces, layers)
    uncoat([piece.owner for piece, _ in pieces])
    for i, (piece, span) in enumerate(pieces):
        if layers[i] is None:
            write_layer(piece, surface.paint[span], surface.vehicle.uvs[span])
        _mark(piece.owner.data, _painted_polygons(surface, piece, span))
    mask = np.repeat(surface.vehicle.paint_mask[..., None], 3, axis=2) / np.float32(255)
    camouflage = color.srgb_to_linear(paintwork.uv_map_srgb / np.float32(255))
    images = float_image("rauca camouflage", camouflage), float_image("rauca paint mask", mask)
    for image in images:
        image.pack()
    coat = Coat.new(*images)
    coat.tree[NAME_KEY], coat.tree[ATLAS_KEY] = paintwork.name, surface.vehicle.atlas_id
    for (_, span), layer in zip(pieces, layers, strict=True):
        for material in surface.materials(span):
            put_on(material, coat, layer or UV_LAYER)
    return coat


def uncoat(objects: list[bpy.types.Object]) -> None:
    """Take the camouflage off objects, and what it brought out of the file."""
    coats = set()
    for thing in objects:
        for slot in thing.material_slots:
            coat = coat_of(slot.material)
            if coat is not None:
                take_off(slot.material)
                coats.add(coat.tree)
        mark = thing.data.attributes.get(PAINTED) if thing.type == "MESH" else None
        if mark is not None and thing.data.library is None:
            thing.data.attributes.remove(mark)
    for tree in coats:
        images = [Coat(tree).image(which) for which in ("camouflage", "mask", "baked")]
        if tree.users <= 1:  # the panel's own pointer to it
            bpy.data.node_groups.remove(tree)
            for image in images:
                if image is not None and image.users == 0:
                    bpy.data.images.remove(image)


def painted_objects(scene: bpy.types.Scene, coat: Coat) -> list[bpy.types.Object]:
    """The objects that wear a coat."""
    return [
        thing
        for thing in scene.objects
        if any((worn := coat_of(slot.material)) is not None and worn.tree == coat.tree for slot in thing.material_slots)
    ]


def _existing_layer(surface: Surface, piece: Piece, span: slice) -> str | None:
    """The UV layer of a piece that already holds the vehicle's UVs, or None."""
    paint = surface.paint[span]
    if piece.layer is None:
        return None
    found, wanted = surface.soup.uvs[span][paint], surface.vehicle.uvs[span][paint]
    return piece.layer if np.allclose(found, wanted, atol=1e-6, equal_nan=False) else None


def _check(surface: Surface, pieces: list[tuple[Piece, slice]], layers: list[str | None]) -> None:
    """Raise :class:`RaucaError` for whatever stands in the way, before anything is changed."""
    used: dict[bpy.types.Material, str] = {}
    for (piece, span), layer in zip(pieces, layers, strict=True):
        if layer is None or not (piece.direct or _whole_slots(surface, piece, span) is not None):
            require_own_faces([piece])
        data = piece.owner.data
        if piece.owner.type != "MESH" or data.library is not None:
            require_own_faces([piece])
        for worn in surface.materials(span):
            material = require_coatable(worn, piece.owner.name)
            other = used.setdefault(material, layer or UV_LAYER)
            if other != (layer or UV_LAYER):
                raise contract.RaucaError(
                    f"{material.name}: parts that share it keep their UVs in layers {other!r} and {layer!r}; "
                    "give these layers one name"
                )


def _whole_slots(surface: Surface, piece: Piece, span: slice) -> NDArray[np.bool_] | None:
    """Painted polygons of a mesh whose modifiers add faces, where its materials or its marks tell; else None."""
    mesh = piece.owner.data
    if piece.owner.type != "MESH":
        return None
    marks = mesh.attributes.get(PAINT_MARK)
    if marks is not None and (surface.soup.marked[span] == surface.paint[span]).all():
        return values_of(marks.data, "value", (len(mesh.polygons),), np.bool_)
    painted = {surface.soup.names[i] for i in np.unique(surface.soup.material[span][surface.paint[span]])}
    if np.isin(np.array(surface.soup.names)[surface.soup.material[span]], list(painted)).tolist() != list(
        surface.paint[span]
    ):
        return None
    slots = [slot.material is not None and slot.material.name in painted for slot in piece.owner.material_slots]
    index = values_of(mesh.polygons, "material_index", (len(mesh.polygons),), np.int32)
    return np.array(slots, np.bool_)[np.minimum(index, len(slots) - 1)]


def _painted_polygons(surface: Surface, piece: Piece, span: slice) -> NDArray[np.bool_]:
    if not piece.direct:
        polygons = _whole_slots(surface, piece, span)
        assert polygons is not None  # _check saw to it
        return polygons
    polygons = np.zeros(len(piece.owner.data.polygons), np.bool_)
    polygons[piece.polygon[surface.paint[span]]] = True
    return polygons


def _mark(mesh: bpy.types.Mesh, polygons: NDArray[np.bool_]) -> None:
    mark = mesh.attributes.get(PAINTED) or mesh.attributes.new(PAINTED, "FLOAT", "FACE")
    mark.data.foreach_set("value", polygons.astype(np.float32))
    mesh.update()
