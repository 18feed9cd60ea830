"""The artist's meshes: the faces of a vehicle among them, which may be written to, marks, a UV layer, the selection."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bmesh
import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .paint import UV_LAYER
from .vehicle_arrays import PAINT_MARK, Piece, Soup, marked_faces, read_objects


@contextlib.contextmanager
def object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Leave edit, sculpt or paint mode for a while, so that meshes are up to date and may be written to."""
    active = context.view_layer.objects.active
    mode = active.mode if active is not None else "OBJECT"
    if mode == "OBJECT":
        yield
        return
    bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        bpy.ops.object.mode_set(mode=mode)


def leave_mode(context: bpy.types.Context) -> None:
    """Leave edit, sculpt or paint mode for good."""
    active = context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def require_writable(thing: bpy.types.Object) -> None:
    """Raise :class:`RaucaError` for a mesh that is not this object's own: of a library, or shared."""
    mesh = thing.data
    for block in (thing, mesh):
        if block.library is not None:
            raise contract.RaucaError(
                f"{thing.name}: is linked from {block.library.filepath}; Object > Relations > Make Local > All first"
            )
    if mesh.users - mesh.use_fake_user > 1:
        raise contract.RaucaError(
            f"{thing.name}: other objects share its mesh; Object > Relations > Make Single User > Object & Data first"
        )


def require_own_faces(pieces: Iterable[Piece]) -> None:
    """Raise :class:`RaucaError` as :func:`require_writable`, and for curves, instances, or modifiers that add faces."""
    for piece in pieces:
        name = piece.owner.name
        if piece.owner.type == "EMPTY" or piece.instance:
            raise contract.RaucaError(f"{name}: its faces are instances; Object > Apply > Make Instances Real first")
        if piece.owner.type != "MESH":
            raise contract.RaucaError(f"{name}: is no mesh; Object > Convert > Mesh first")
        if not piece.direct:
            shown = ", ".join(m.name for m in piece.owner.modifiers if m.show_viewport)
            raise contract.RaucaError(
                f"{name}: its modifiers ({shown}) change its faces; Object > Convert > Mesh applies them"
            )
        require_writable(piece.owner)


def write_layer(piece: Piece, faces: NDArray[np.bool_], uvs: NDArray[np.float32], name: str = UV_LAYER) -> None:
    """Write UVs (f, 3, 2) of a piece's triangles where ``faces`` (f,) is True into a layer, else the camouflage's.

    The layer that renders show stays the one it was; the camouflage's becomes the one that is edited.

    Raises:
        RaucaError: the mesh has no room for another UV layer; nothing was changed.
    """
    mesh = piece.owner.data
    edited = mesh.uv_layers.active.name if mesh.uv_layers.active is not None else name
    layer = mesh.uv_layers.get(name)
    if layer is None:
        layer = mesh.uv_layers.new(name=name, do_init=False)
        if layer is None:
            raise contract.RaucaError(f"{piece.owner.name}: has 8 UV layers, Blender's most; remove one")
    values = np.zeros((len(mesh.loops), 2), np.float32)
    values[piece.loops[faces].ravel()] = uvs[faces].reshape(-1, 2)
    layer.uv.foreach_set("vector", values.ravel())
    mesh.uv_layers.active = layer if name == UV_LAYER else mesh.uv_layers[edited]
    mesh.update()


def mark_faces(mesh: bpy.types.Mesh, marked: NDArray[np.bool_]) -> None:
    """Mark exactly these polygons (polygons,) as paint."""
    mark = mesh.attributes.get(PAINT_MARK)
    if mark is not None and (mark.domain, mark.data_type) != ("FACE", "BOOLEAN"):
        mesh.attributes.remove(mark)
        mark = None
    if mark is None:
        mark = mesh.attributes.new(PAINT_MARK, "BOOLEAN", "FACE")
    mark.data.foreach_set("value", marked)
    mesh.update()


def select_faces(context: bpy.types.Context, wanted: dict[bpy.types.Object, NDArray[np.bool_]]) -> None:
    """Enter edit mode on these objects with exactly these polygons selected; from object mode."""
    for other in context.view_layer.objects:
        other.select_set(other in wanted)
    for thing, faces in wanted.items():
        mesh = thing.data
        mesh.vertices.foreach_set("select", np.zeros(len(mesh.vertices), np.bool_))
        mesh.edges.foreach_set("select", np.zeros(len(mesh.edges), np.bool_))
        mesh.polygons.foreach_set("select", faces)
        mesh.update()
    context.view_layer.objects.active = max(wanted, key=lambda thing: int(wanted[thing].sum()))
    context.tool_settings.mesh_select_mode = (False, False, True)
    bpy.ops.object.mode_set(mode="EDIT")


def marked_count(thing: bpy.types.Object) -> int:
    """Polygons of a mesh object marked as paint, in edit mode too."""
    if thing.mode != "EDIT":
        return int(marked_faces(thing.data).sum())
    faces = bmesh.from_edit_mesh(thing.data).faces
    mark = faces.layers.bool.get(PAINT_MARK)
    return sum(face[mark] for face in faces) if mark is not None else 0


@dataclass(frozen=True, eq=False)
class Surface:
    """A vehicle, the triangles of its objects in world space, in the same order, and which (F,) are paint."""

    vehicle: contract.Vehicle
    soup: Soup
    paint: NDArray[np.bool_]

    @staticmethod
    def of(vehicle: contract.Vehicle, objects: list[bpy.types.Object]) -> Surface:
        """Read ``objects``, which make up ``vehicle``; :class:`RaucaError` if their faces are not the vehicle's."""
        soup = read_objects(objects)
        if len(soup.triangles) != len(vehicle.triangles):
            raise contract.RaucaError(
                f"{vehicle.name}: its objects have {len(soup.triangles)} triangles, the vehicle "
                f"{len(vehicle.triangles)}; choose the vehicle again in step 1"
            )
        return Surface(vehicle, soup, vehicle.paint_faces())

    def painted_pieces(self) -> list[Piece]:
        """The pieces with paint on them."""
        return self.soup.painted(self.paint)

    def materials(self, piece: Piece) -> list[bpy.types.Material | None]:
        """The scene's materials on the paint of a piece."""
        used = np.unique(self.soup.material[piece.span][self.paint[piece.span]])
        return [self.soup.blocks[self.soup.names[i]] for i in used]

    def vehicle_to_world(self) -> NDArray[np.float64]:
        """Where the objects stand: the rigid (4, 4) transform that takes the vehicle to them, by least squares."""
        here, there = self.vehicle.positions.astype(np.float64), self.soup.positions
        one, other = here.mean(axis=0), there.mean(axis=0)
        u, _, v = np.linalg.svd((there - other).T @ (here - one))
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, other - turn @ one
        return pose
