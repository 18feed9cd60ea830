"""The faces of the vehicle that are paint, tinted in the viewport. Nothing of it is in the user's file."""

from __future__ import annotations

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix
from numpy.typing import NDArray

from ...core import contract
from ...scene.blocks import values_of
from ...scene.vehicle_arrays import SHAPES, marked_faces
from ..panel import ViewportOverlay

COLOR = (1.0, 0.05, 0.8, 0.4)  # linear; neither Blender's own lines nor many cars have it
TOWARDS_EYE = 4e-6  # of the depth between the clipping planes: the tint lies before the faces that it is drawn on
Key = tuple[str, str | None]  # an object's name, and its library's file
Faces = tuple[NDArray[np.float32], NDArray[np.int32]]  # vertices (V, 3) in the object's frame, triangles (F, 3)

_revision = [0]  # counts whatever may have changed a mesh of the vehicle, or which of its faces are paint
_parts: dict[str, tuple[Key, ...]] = {}  # the vehicle's objects at the last redraw, by the scene's name
_looked: set[str] = set()  # the scenes in which nothing has changed since: finding parts takes ms among many objects


def paint_faces(context: bpy.types.Context) -> dict[Key, Faces]:
    """The paint on each of the chosen vehicle's objects as the viewport shows them; none while nobody knows the paint.

    What an object instances is left out.
    """
    settings = context.scene.rauca.vehicle
    try:
        painted = set() if settings.paint == "FACES" else set(settings.paint_materials(context))
    except contract.RaucaError:
        return {}
    found = {}
    for thing in settings.objects(context):
        if thing.type in SHAPES:
            vertices, triangles = _faces(thing, context, None if settings.paint == "FACES" else painted)
            if len(triangles):
                found[_key(thing)] = vertices, triangles
    return found


def _faces(thing: bpy.types.Object, context: bpy.types.Context, painted: set[str] | None) -> Faces:
    """Of one object: where these materials are, or where faces are marked if there are no materials to go by."""
    evaluated = thing.evaluated_get(context.view_layer.depsgraph)
    mesh = evaluated.to_mesh()
    if mesh is None:
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
    mesh.calc_loop_triangles()
    if painted is None:
        wanted = marked_faces(mesh)[values_of(mesh.loop_triangles, "polygon_index", np.int32)]
    else:
        slots = [slot.material.name if slot.material is not None else "" for slot in evaluated.material_slots] or [""]
        index = np.minimum(values_of(mesh.loop_triangles, "material_index", np.int32), len(slots) - 1)
        wanted = np.array([name in painted for name in slots])[index]
    faces = (
        values_of(mesh.vertices, "co", np.float32, 3),
        values_of(mesh.loop_triangles, "vertices", np.int32, 3)[wanted],
    )
    evaluated.to_mesh_clear()
    return faces


def _key(block: bpy.types.ID) -> Key:
    return block.name, block.library.filepath if block.library is not None else None


def _draw(context: bpy.types.Context) -> None:
    settings = context.scene.rauca.vehicle
    if not settings.tint or context.mode != "OBJECT":
        return
    scene = context.scene.name_full
    if scene not in _looked:
        _looked.add(scene)
        _parts[scene] = tuple(_key(thing) for thing in settings.objects(context))
    material = settings.material.name if settings.material is not None else ""
    key = (_revision[0], _parts[scene], settings.paint, material)
    batches = _tint.kept(key, lambda: _on_card(paint_faces(context)))
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("color", COLOR)
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(False)
    nearer = Matrix.Translation((0.0, 0.0, -TOWARDS_EYE)) @ gpu.matrix.get_projection_matrix()
    with gpu.matrix.push_pop_projection():
        gpu.matrix.load_projection_matrix(nearer)
        for name, batch in batches.items():
            thing = bpy.data.objects.get(name)
            if thing is not None and thing.visible_get(viewport=context.space_data):
                with gpu.matrix.push_pop():
                    gpu.matrix.multiply_matrix(thing.matrix_world)  # so a moved object's faces are not read again
                    batch.draw(shader)
    gpu.state.depth_mask_set(True)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _on_card(faces: dict[Key, Faces]) -> dict[Key, gpu.types.GPUBatch]:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    return {
        name: batch_for_shader(shader, "TRIS", {"pos": vertices}, indices=triangles)
        for name, (vertices, triangles) in faces.items()
    }


@bpy.app.handlers.persistent
def _updated(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """The vehicle's meshes count and materials, by whose names paint is known; where it stands does not."""
    _looked.clear()
    known = set().union(*_parts.values())
    for update in depsgraph.updates:
        block = update.id
        reshaped = isinstance(block, bpy.types.Object) and update.is_updated_geometry and _key(block) in known
        if reshaped or isinstance(block, bpy.types.Material):
            _revision[0] += 1
            return


@bpy.app.handlers.persistent
def _replaced(*given: object) -> None:
    """Another file, another state of this one, or another frame of an animation."""
    _looked.clear()
    _revision[0] += 1


HANDLERS = {
    "depsgraph_update_post": _updated,
    **dict.fromkeys(("undo_post", "redo_post", "load_post", "frame_change_post"), _replaced),
}
_tint = ViewportOverlay(_draw, "POST_VIEW")


def register() -> None:
    _tint.register()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in HANDLERS.items():
        handlers = getattr(bpy.app.handlers, name)
        if handler in handlers:
            handlers.remove(handler)
    _tint.unregister()
    _parts.clear()
    _looked.clear()
