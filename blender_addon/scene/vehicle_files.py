"""Any vehicle file into the contract's vehicle; the running Blender opens it, and no trace of it is left."""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Iterator
from pathlib import Path

import addon_utils
import bpy

from ..core import contract, reading
from .blocks import Since, rendered_by, set_within
from .gltf_check import check_gltf
from .images import image_header, read_image_blender
from .render import silenced
from .vehicle import load_shipped, shipped_names
from .vehicle_arrays import SHAPES
from .vehicle_reading import read_vehicle
from .vehicle_request import VehicleRequest

SUFFIXES = (".obj", ".glb", ".gltf", ".blend")
DAMAGE = (
    RuntimeError, OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, struct.error,
    ArithmeticError, AssertionError, MemoryError,
)  # fmt: skip
MAX_OBJ_BYTES = 2**30
"""A vehicle of five million faces has some 600 MB; Blender's reader takes several times the file's size."""
_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]*)", re.MULTILINE)
NOT_FINITE = re.compile(rb"^v[ \t][^\n]*?(nan|inf)", re.IGNORECASE | re.MULTILINE)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[list[bpy.types.Object]]:
    """Import a file; yields its objects, linked to the present scene, and removes everything it brought.

    OBJ files keep their axes as they are in the file; glTF comes in Blender's (z up).

    Raises:
        RaucaError: missing or damaged file, or a format that is not read.
    """
    if not path.is_file():
        raise contract.RaucaError(f"{path}: not found")
    if path.suffix.lower() not in SUFFIXES:
        raise contract.RaucaError(f"{path}: format {path.suffix!r} is not read; use {', '.join(SUFFIXES)}")
    new = Since()
    try:
        with damage_told(path, "export it again"):
            _require_finite(path)
            layer = bpy.context.view_layer  # whose active collection, to which importers add, may be hidden
            with silenced(), set_within((layer, "active_layer_collection", layer.layer_collection)):
                _import(path)
            _check_images([block for block in new.blocks() if isinstance(block, bpy.types.Image)], path)
        bpy.context.view_layer.update()
        yield [block for block in new.blocks() if isinstance(block, bpy.types.Object)]
    finally:
        bpy.data.batch_remove(new.blocks())


@contextlib.contextmanager
def damage_told(path: Path, remedy: str) -> Iterator[None]:
    """Within: whatever importers raise on files that are not what their name says is one :class:`RaucaError`."""
    try:
        yield
    except DAMAGE as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
        raise contract.RaucaError(f"{path}: cannot be read as {path.suffix} ({reason}); {remedy}") from error


def _require_finite(path: Path) -> None:
    """Raise :class:`RaucaError` on NaN: Blender's importers turn it into zeros without a word."""
    suffix = path.suffix.lower()
    bad = 0
    if suffix == ".obj":
        text = reading.read_limited(path, MAX_OBJ_BYTES, "a vehicle")
        for name in _LIBRARY.findall(text):
            _refuse_outside(path, name.decode(errors="replace").strip())
        bad = len(NOT_FINITE.findall(text))
    elif suffix in (".glb", ".gltf"):
        bad = check_gltf(path)
    if bad:
        raise contract.RaucaError(f"{path}: {bad} vertices are NaN or infinite; repair the mesh")


def _import(path: Path) -> None:
    suffix = path.suffix.lower()
    if suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z", validate_meshes=False)
    elif suffix == ".blend":
        _append(path)
    else:
        addon_utils.enable("io_scene_gltf2")
        bpy.ops.import_scene.gltf(filepath=str(path), loglevel=50)


def _append(path: Path) -> None:
    """Append the objects that renders of a .blend's scenes show; of an asset's file, whose scenes hold none, all."""
    with scripts_off(), bpy.data.libraries.load(str(path), link=False) as (source, target):
        target.scenes, target.objects = source.scenes, source.objects
    scenes = [scene for scene in target.scenes if scene is not None]
    staged = any(o.type in SHAPES or o.instance_type == "COLLECTION" for scene in scenes for o in scene.objects)
    shown = {thing for scene in scenes for layer in scene.view_layers for thing in rendered_by(layer)}
    for item in target.objects:
        if item is not None and (item in shown or not staged):
            bpy.context.scene.collection.objects.link(item)


@contextlib.contextmanager
def scripts_off() -> Iterator[None]:
    """Append from a .blend without running anything of it, however much the user's preferences trust others.

    Texts are never run on appending. Drivers could be when the scene is next evaluated: they are removed, so that
    driven values stay as they were saved.
    """
    new = Since()
    with set_within((bpy.context.preferences.filepaths, "use_scripts_auto_execute", False)):
        try:
            yield
        finally:
            for block in new.blocks():
                for owner in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
                    if (animation := getattr(owner, "animation_data", None)) is not None:
                        for driver in list(animation.drivers):
                            animation.drivers.remove(driver)


def _check_images(fresh: list[bpy.types.Image], path: Path) -> None:
    """Textures are of a size that fits in memory; those of an .obj or glTF lie in its folder, if anywhere.

    A .blend is a project of the artist's, whose textures and libraries may lie where they like. It brings skies and
    more that its vehicle does not use, which are never decoded.
    """
    appended = path.suffix.lower() == ".blend"
    users = bpy.data.user_map() if appended else {}
    vehicle = set(bpy.context.scene.collection.objects)
    for image in fresh:
        if image.source != "FILE" or (appended and vehicle.isdisjoint(_all_users(image, users))):
            continue
        if image.packed_file is not None:
            header = bytes(image.packed_file.data[: reading.HEADER_BYTES])
        else:
            named = bpy.path.abspath(image.filepath, library=image.library)
            if not appended:
                _refuse_outside(path, named)
            header = image_header(Path(named))
        reading.require_size(header, f"{path}: image {image.name!r}")


def _all_users(block: bpy.types.ID, users: dict[bpy.types.ID, set[bpy.types.ID]]) -> set[bpy.types.ID]:
    """All that uses a block, by way of others too; ``users`` are those that use each block themselves."""
    found: set[bpy.types.ID] = set()
    left = [block]
    while left:
        fresh = users.get(left.pop(), set()) - found
        found |= fresh
        left += fresh
    return found


def _refuse_outside(path: Path, named: str) -> None:
    """A file outside that does not exist is none that could be read: exporters leave paths of their own machine."""
    if "\0" not in named and (path.parent / named).exists():
        reading.require_inside(path, named)


def find_vehicle(source: contract.VehicleSource) -> contract.Vehicle:
    """The vehicle a user names: one that is shipped, or any that :func:`import_vehicle` reads.

    Raises:
        RaucaError: there is none of that name, the file cannot be used, or a shipped one is given a paint option.
    """
    known, path = shipped_names(), Path(source.name)
    if source.name in known:
        if source.paint_mask or source.paint_material:
            raise contract.RaucaError(f"--vehicle {source.name} brings its own paint; drop the paint option")
        return load_shipped(source.name)
    if not path.exists():
        raise contract.RaucaError(
            f"{path}: no such vehicle; give an .obj, .glb or .blend file, or one of {', '.join(known)}"
        )
    return import_vehicle(path, source.paint_mask, source.paint_material)


def import_vehicle(path: Path, paint_mask: Path | None = None, paint_material: str | None = None) -> contract.Vehicle:
    """Read a vehicle from an .obj, .glb, .gltf or .blend file, or from a rauca vehicle folder.

    The session's own data is left as it was. What was assumed about axes, paint and UVs is told in ``notes``.

    Args:
        paint_mask: grey PNG in the vehicle's own UVs, white where the camouflage may go.
        paint_material: name of the material to camouflage.

    Raises:
        RaucaError: a missing or damaged file, no faces, NaN vertices, implausible size, or no telling what is paint.
    """
    path = Path(path)
    if path.is_dir():
        if paint_mask or paint_material:
            raise contract.RaucaError(f"{path}: a vehicle folder brings its own paint; drop the paint option")
        return contract.load_vehicle(path, read_image_blender)
    with opened(path) as objects:
        return read_vehicle(
            objects, VehicleRequest(path.stem, path, paint_mask=paint_mask, paint_material=paint_material)
        )
