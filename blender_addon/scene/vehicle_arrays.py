"""The triangles of Blender objects as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import accumulate

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .blocks import rendered, unhidden, values_of
from .paint import UV_LAYER

SHAPES = ("MESH", "CURVE", "SURFACE", "META", "FONT")  # objects that have faces
MAX_FACES = 2**24  # of all objects and instances together: as arrays some 3 GiB; scans of cars have one or two million
PAINT_MARK = "rauca_paint"  # boolean attribute of faces: marked as paint by hand


@dataclass
class Piece:
    """Where a run of triangles comes from, for writing back what was found out about them.

    Attributes:
        owner: the object in the scene, or the instancer.
        instance: the faces are another object's, or another place's, shown by the owner.
        direct: the triangles are those of the owner's own mesh, unaltered by modifiers, curves or instances.
        polygon: (f,) polygon of each triangle.
        loops: (f, 3) mesh loop of each corner.
        layer: name of the UV layer read, or None.
        layers: number of UV layers of the mesh.
        shows_layer: renders show that layer, so the materials' textures belong to it.
        span: its run of the soup's triangles.
    """

    owner: bpy.types.Object
    instance: bool
    direct: bool
    polygon: NDArray[np.int32]
    loops: NDArray[np.int32]
    layer: str | None
    layers: int
    shows_layer: bool
    span: slice


@dataclass
class Soup:
    """Triangles of all objects in world space, metres.

    Attributes:
        positions: (V, 3) float64.
        triangles: (F, 3) int32.
        uvs: (F, 3, 2) float32, NaN where an object has no UVs.
        normals: (F, 3, 3) float32 unit shading normals.
        material: (F,) index into ``names``.
        marked: (F,) True on faces marked as paint by hand (:data:`PAINT_MARK`).
        names: material names; the empty name stands for faces without one.
        blocks: the material of each name.
        pieces: where the triangles come from, in order.
    """

    positions: NDArray[np.float64]
    triangles: NDArray[np.int32]
    uvs: NDArray[np.float32]
    normals: NDArray[np.float32]
    material: NDArray[np.int16]
    marked: NDArray[np.bool_]
    names: list[str] = field(default_factory=list)
    blocks: dict[str, bpy.types.Material | None] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)

    def painted(self, paint: NDArray[np.bool_]) -> list[Piece]:
        """The pieces with paint (F,) on them."""
        return [piece for piece in self.pieces if paint[piece.span].any()]


def read_objects(objects: list[bpy.types.Object]) -> Soup:
    """Join the evaluated meshes of objects, and of what they instance; objects hidden from renders are left out.

    In the order of the objects' names, so that one vehicle has one order of faces in every file and scene.
    """
    wanted = rendered(objects)
    with unhidden(wanted):
        return _read({thing.name_full for thing in wanted})


def _read(wanted: set[str]) -> Soup:
    """The meshes of the objects of these names."""
    blocks: dict[str, bpy.types.Material | None] = {}
    found: list[tuple[tuple[str, list[int]], Soup]] = []
    faces = 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        owner = instance.parent if instance.is_instance else instance.object
        if owner is None or owner.original.name_full not in wanted:
            continue
        if not (instance.show_self or instance.is_instance):
            continue
        item = instance.object
        if item.type not in SHAPES:
            continue
        mesh = item.to_mesh()
        faces += 0 if mesh is None else len(mesh.polygons)
        if faces > MAX_FACES:
            raise contract.RaucaError(f"{owner.original.name}: with it there are more than {MAX_FACES} faces; too many")
        if mesh is not None and len(mesh.polygons):
            slots = [_name(slot.material, blocks) for slot in item.material_slots] or [_name(None, blocks)]
            original, to_world = owner.original, np.array(instance.matrix_world)
            direct = not instance.is_instance and item.type == "MESH" and _same_faces(mesh, original.data)
            origin = (original, bool(instance.is_instance), direct)
            place = (original.name_full, list(instance.persistent_id))
            found.append((place, _triangles(mesh, to_world, slots, origin)))
        item.to_mesh_clear()
    return _joined([soup for _, soup in sorted(found, key=lambda entry: entry[0])], blocks)


def read_layer(mesh: bpy.types.Mesh) -> bpy.types.MeshUVLoopLayer | None:
    """The UV layer of a vehicle's mesh: the camouflage's own if there is one, else the one that renders show."""
    shown = next((u for u in mesh.uv_layers if u.active_render), mesh.uv_layers.active)
    return mesh.uv_layers.get(UV_LAYER) or shown


def _name(material: bpy.types.Material | None, blocks: dict[str, bpy.types.Material | None]) -> str:
    """The name under which a material is known; a linked one that shares its name tells its library too."""
    block = material.original if material is not None else None
    name = ""
    if block is not None:
        name = block.name if bpy.data.materials.get(block.name) == block else block.name_full
    blocks[name] = block
    return name


def _same_faces(mesh: bpy.types.Mesh, original: bpy.types.Mesh) -> bool:
    """True when no modifier changed which vertices make up which face."""
    shape = (len(mesh.vertices), len(mesh.loops), len(mesh.polygons))
    if shape != (len(original.vertices), len(original.loops), len(original.polygons)):
        return False
    one, two = (values_of(m.loops, "vertex_index", np.int32) for m in (mesh, original))
    return bool((one == two).all())


def _triangles(
    mesh: bpy.types.Mesh, to_world: NDArray[np.float64], slots: list[str], origin: tuple[bpy.types.Object, bool, bool]
) -> Soup:
    """One mesh in world space; ``origin`` is the piece's owner, and whether it is an instance, and direct."""
    mesh.calc_loop_triangles()
    positions = values_of(mesh.vertices, "co", np.float32, 3).astype(np.float64)
    corners = values_of(mesh.loop_triangles, "loops", np.int32, 3)
    vertex = values_of(mesh.loops, "vertex_index", np.int32)
    normals = values_of(mesh.corner_normals, "vector", np.float32, 3)[corners]
    slot = values_of(mesh.loop_triangles, "material_index", np.int32)
    polygon = values_of(mesh.loop_triangles, "polygon_index", np.int32)
    layer = read_layer(mesh)
    bare = np.full((len(mesh.loops), 2), np.nan, np.float32)
    uvs = bare if layer is None else values_of(layer.uv, "vector", np.float32, 2)
    linear = to_world[:3, :3]
    positions = positions @ linear.T + to_world[:3, 3]
    if np.linalg.det(linear) < 0:  # a mirrored object turns its faces inside out
        corners, normals = corners[:, ::-1], normals[:, ::-1]
    normals = normals.astype(np.float64) @ np.linalg.pinv(linear)
    triangles = vertex[corners]
    material = np.minimum(slot, len(slots) - 1).astype(np.int16)
    shown = layer is not None and (layer.active_render or len(mesh.uv_layers) == 1)
    name, count, alone = layer.name if layer else None, len(mesh.uv_layers), slice(0, len(triangles))
    piece = Piece(*origin, polygon, corners, name, count, shown, alone)
    marked, normals = marked_faces(mesh)[polygon], _unit(normals, positions, triangles)
    return Soup(positions, triangles, uvs[corners], normals, material, marked, slots, pieces=[piece])


def marked_faces(mesh: bpy.types.Mesh) -> NDArray[np.bool_]:
    """(polygons,) True where marked as paint by hand; of a mesh in object mode."""
    mark = mesh.attributes.get(PAINT_MARK)
    if mark is None or mark.domain != "FACE" or mark.data_type != "BOOLEAN":
        return np.zeros(len(mesh.polygons), np.bool_)
    return values_of(mark.data, "value", np.bool_)


def _unit(
    normals: NDArray[np.float64], positions: NDArray[np.float64], faces: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Normals of length 1; a corner without one takes its face's, a face without area looks up."""
    edges = positions[faces[:, 1:]] - positions[faces[:, :1]]
    flat = np.cross(edges[:, 0], edges[:, 1])[:, None, :] * np.ones((1, 3, 1))
    flat = np.where(np.linalg.norm(flat, axis=2, keepdims=True) > 1e-30, flat, [0.0, 0.0, 1.0])
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    chosen = np.where(np.isfinite(length) & (length > 1e-6), normals, flat)
    return (chosen / np.linalg.norm(chosen, axis=2, keepdims=True)).astype(np.float32)


def _joined(found: list[Soup], blocks: dict[str, bpy.types.Material | None]) -> Soup:
    names = list(dict.fromkeys(name for soup in found for name in soup.names))
    if not found:
        faces, none = np.zeros((0, 3, 3), np.float32), np.zeros(0, np.int16)
        return Soup(np.zeros((0, 3)), faces[..., 0].astype(np.int32), faces[..., :2], faces, none, none.astype(bool))
    first = np.cumsum([0] + [len(p.positions) for p in found[:-1]])
    ends = accumulate(len(p.triangles) for p in found)
    return Soup(
        np.concatenate([p.positions for p in found]),
        np.concatenate([p.triangles + start for p, start in zip(found, first, strict=True)]).astype(np.int32),
        np.concatenate([p.uvs for p in found]),
        np.concatenate([p.normals for p in found]),
        np.concatenate([np.array([names.index(n) for n in p.names], np.int16)[p.material] for p in found]),
        np.concatenate([p.marked for p in found]),
        names,
        blocks,
        [replace(p.pieces[0], span=slice(end - len(p.triangles), end)) for p, end in zip(found, ends, strict=True)],
    )
