"""Opens a vehicle file in the running Blender, and leaves no trace of it."""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Iterator
from pathlib import Path

import addon_utils
import bpy

from ..core import contract
from .gltf_check import bad_vertices
from .render import silenced

SUFFIXES = (".obj", ".glb", ".gltf", ".blend")
# What importers raise on files that are not what their name says.
DAMAGE = (
    RuntimeError, OSError, ValueError, KeyError, IndexError, TypeError, AttributeError, EOFError, struct.error
)  # fmt: skip
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
    before = {block.as_pointer() for block in all_blocks()}
    known = {o.as_pointer() for o in bpy.data.objects}
    try:
        try:
            _require_finite(path)
            with silenced():
                _import(path)
        except DAMAGE as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
            raise contract.RaucaError(f"{path}: cannot be read as {path.suffix} ({reason}); export it again") from error
        bpy.context.view_layer.update()
        yield [o for o in bpy.data.objects if o.as_pointer() not in known]
    finally:
        bpy.data.batch_remove([block for block in all_blocks() if block.as_pointer() not in before])


def _require_finite(path: Path) -> None:
    """Raise :class:`RaucaError` on NaN: Blender's importers turn it into zeros without a word."""
    suffix = path.suffix.lower()
    bad = 0
    if suffix == ".obj":
        bad = len(NOT_FINITE.findall(path.read_bytes()))
    elif suffix in (".glb", ".gltf"):
        bad = bad_vertices(path)
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
    """Append all objects of a .blend.

    Text blocks are never run, and drivers only as far as the user's own preferences trust scripts.
    """
    preferences = bpy.context.preferences.filepaths
    trusted = preferences.use_scripts_auto_execute
    preferences.use_scripts_auto_execute = False
    try:
        with bpy.data.libraries.load(str(path), link=False) as (source, target):
            target.objects = source.objects
        for item in target.objects:
            if item is not None:
                bpy.context.scene.collection.objects.link(item)
    finally:
        preferences.use_scripts_auto_execute = trusted


def all_blocks() -> list[bpy.types.ID]:
    """Every data block of the session."""
    collections = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    return [block for name in collections for block in getattr(bpy.data, name)]
