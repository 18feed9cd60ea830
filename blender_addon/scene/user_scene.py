"""The user's own ``.blend`` as a place: empties mark where the vehicle stands.

The file's objects are added to the data set's scene; its world and suns stay behind, as the weather brings its own. No
script of the file is run: texts are not read, and drivers are removed, so that driven values stay as they were saved.
"""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import clips, contract, semantics
from .annotatable import require_annotatable
from .blocks import Since, layers_below
from .massing import turned
from .render import silenced
from .vehicle_files import damage_told, scripts_off

MARK = "rauca"
LAMP_MARK = "rauca lamp"


class UserScene:
    """A scene of the user's.

    Attributes:
        lamps: light objects whose name starts with ``rauca lamp``; the weather switches them on at night.
        notes: what was left out or assumed, for people.
    """

    def __init__(self, scene: bpy.types.Scene, path: Path, locations: int, own: str = "car") -> None:
        """Add a file's scene to ``scene``.

        Args:
            path: the ``.blend``; of several scenes, the one with the marks is taken.
            locations: how many places are needed.
            own: class of the data set's vehicle, of which nothing else may be.

        Raises:
            RaucaError: not a readable ``.blend``, no or too few marks, a linked file is missing, a material names an
                unknown semantic class, or the masks could not be right (see `annotatable.py`).
        """
        self.notes: list[str] = []
        new = Since()
        try:
            source = _marked(_appended(path), path)
            _adopt(scene, source)
            _make_local(new)
            self._leave_light_behind(source, new.blocks(), path)
            fresh = new.blocks()
            _show_what_renders_show(fresh)
            self._check_files(fresh, path)
            self._classify(fresh, path)
            scene.frame_set(source.frame_current)
            require_annotatable(scene, own, str(path))
            marks = sorted((o for o in source.objects if _is_mark(o)), key=lambda mark: mark.name)
            if len(marks) < locations:
                raise contract.RaucaError(
                    f"{path}: marks {len(marks)} locations ({', '.join(m.name for m in marks)}) but {locations} are "
                    f"asked for; add empties named {MARK}..., or pass --locations {len(marks)}"
                )
            layer = scene.view_layers[0]
            layer.update()
            # Outside a window Blender leaves the originals' world matrices as they were: ask the evaluated ones.
            self._poses = [_pose(mark.evaluated_get(layer.depsgraph), path) for mark in marks]
            self.lamps = [o for o in source.objects if o.type == "LIGHT" and o.name.lower().startswith(LAMP_MARK)]
            for extra in [block for block in fresh if isinstance(block, bpy.types.Scene)]:
                bpy.data.scenes.remove(extra)
        except contract.RaucaError:
            bpy.data.batch_remove(new.blocks())
            raise

    def pose(self, location: int) -> NDArray[np.float64]:
        """(4, 4) vehicle-to-world transform: wheels at the mark's height, front along its x axis seen from above."""
        return self._poses[location].copy()

    def street(self, location: int) -> clips.Street:
        """A straight lane along the mark's x axis."""
        return clips.Street(self.pose(location))

    def enter(self, location: int) -> None:
        """Nothing to change: the whole scene is always there."""

    def light_windows(self, level: float) -> None:
        """Nothing to switch: the file's materials are its own."""

    def _leave_light_behind(self, source: bpy.types.Scene, fresh: list[bpy.types.ID], path: Path) -> None:
        lights = [block for block in fresh if isinstance(block, bpy.types.Object) and block.type == "LIGHT"]
        suns = [light for light in lights if light.data.type == "SUN"]  # those in instanced collections too
        left = [f"sun {sun.name!r}" for sun in suns]
        if source.world is not None:
            left.append(f"world {source.world.name!r}")
        if left:
            self.notes.append(f"{path.name}: left out {', '.join(left)}: the weather brings its own light")
        if source.unit_settings.scale_length != 1.0:
            self.notes.append(f"{path.name}: its unit scale is ignored: one Blender unit is taken as one metre")
        bpy.data.batch_remove(suns)

    def _check_files(self, fresh: list[bpy.types.ID], path: Path) -> None:
        """Files that the scene needs beside it."""
        for block in fresh:
            if isinstance(block, bpy.types.Library) and not Path(bpy.path.abspath(block.filepath)).is_file():
                raise contract.RaucaError(
                    f"{path}: links to {block.filepath}, which is missing; bring it or make it local"
                )
            on_disk = isinstance(block, bpy.types.Image) and block.source == "FILE" and block.packed_file is None
            if on_disk and not Path(bpy.path.abspath(block.filepath, library=block.library)).is_file():
                raise contract.RaucaError(f"{path}: image {block.filepath} is missing; pack the file's resources")

    def _classify(self, fresh: list[bpy.types.ID], path: Path) -> None:
        """Give every material a semantic class: its own, or ``other``."""
        unnamed = 0
        for material in (block for block in fresh if isinstance(block, bpy.types.Material)):
            named = material.get(semantics.CLASS_PROPERTY)
            if named is None:
                unnamed += 1
                if material.library is None:
                    material[semantics.CLASS_PROPERTY] = "other"
            elif named not in semantics.CLASS_IDS:
                raise contract.RaucaError(
                    f"{path}: material {material.name!r} has {semantics.CLASS_PROPERTY} {named!r}; use one of "
                    f"{', '.join(semantics.CLASSES)}"
                )
        if unnamed:
            self.notes.append(
                f"{path.name}: {unnamed} materials name no {semantics.CLASS_PROPERTY} and show as 'other' in the masks"
            )


def _appended(path: Path) -> list[bpy.types.Scene]:
    """All scenes of a file, appended, their drivers removed before anything could evaluate them."""
    with (
        damage_told(path, "save it again"),
        scripts_off(),
        silenced(),
        bpy.data.libraries.load(str(path), link=False) as (source, target),
    ):
        target.scenes = source.scenes
    return [scene for scene in target.scenes if scene is not None]


def _marked(scenes: list[bpy.types.Scene], path: Path) -> bpy.types.Scene:
    """The scene that has marks."""
    marked = [scene for scene in scenes if any(_is_mark(o) for o in scene.objects)]
    if not marked:
        raise contract.RaucaError(
            f"{path}: marks no location; add an empty named {MARK}... where the vehicle shall stand"
        )
    if len(marked) > 1:
        names = ", ".join(scene.name for scene in marked)
        raise contract.RaucaError(f"{path}: several of its scenes mark locations ({names}); keep the marks in one")
    return marked[0]


def _is_mark(thing: bpy.types.Object) -> bool:
    return thing.type == "EMPTY" and thing.name.lower().startswith(MARK)


def _adopt(scene: bpy.types.Scene, source: bpy.types.Scene) -> None:
    """Link a scene's collections and objects to another; what its view layer leaves out is not rendered."""
    for layer in layers_below(source.view_layers[0].layer_collection):
        if layer.exclude:
            layer.collection.hide_render = True
    for collection in source.collection.children:
        scene.collection.children.link(collection)
    for thing in source.collection.objects:
        scene.collection.objects.link(thing)


def _make_local(new: Since) -> None:
    """Make local what the file links from others: a linked surface's material cannot be exchanged.

    From the outside in, as only what nothing linked uses becomes local itself, and not a copy beside it.
    """
    for kind in (bpy.types.Collection, bpy.types.Object):
        for block in new.blocks():
            if isinstance(block, kind) and block.library is not None:
                block.make_local()
    shapes = {block.data for block in new.blocks() if isinstance(block, bpy.types.Object)} - {None}
    for shape in shapes:
        if shape.library is not None:
            shape.make_local()


def _show_what_renders_show(fresh: list[bpy.types.ID]) -> None:
    """The viewport's own hiding ends: masks are prepared from what the viewport shows."""
    for block in fresh:
        if isinstance(block, bpy.types.Object | bpy.types.Collection) and not block.hide_render:
            block.hide_viewport = False
        for modifier in getattr(block, "modifiers", ()):
            if modifier.type == "NODES":
                modifier.show_viewport = modifier.show_render


def _pose(mark: bpy.types.Object, path: Path) -> NDArray[np.float64]:
    """(4, 4) of an empty: its place and its turn about z; tilt and scale are dropped."""
    matrix = np.array(mark.matrix_world)
    forward = matrix[:2, 0]
    if not np.isfinite(matrix).all() or np.linalg.norm(forward) < 1e-3 * np.linalg.norm(matrix[:3, 0]):
        raise contract.RaucaError(f"{path}: empty {mark.name!r} has no direction seen from above; lay its x axis level")
    return turned(math.atan2(forward[1], forward[0]), *matrix[:3, 3])
