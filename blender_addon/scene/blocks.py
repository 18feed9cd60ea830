"""Blender's data blocks: which came after a moment, which renders show, their values, what is set for a while."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray


def all_blocks() -> list[bpy.types.ID]:
    """Every data block of the session."""
    kinds = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    collections = [kind for kind in kinds if kind != "all_ids"]  # Blender 5.3 lists all of them there once more
    return [block for name in collections for block in getattr(bpy.data, name)]


class Since:
    """What comes into the session from now on."""

    def __init__(self) -> None:
        self._known = {block.as_pointer() for block in all_blocks()}

    def blocks(self) -> list[bpy.types.ID]:
        """The data blocks that came."""
        return [block for block in all_blocks() if block.as_pointer() not in self._known]


def values_of(collection: bpy.types.bpy_prop_collection, name: str, kind: type, *each: int) -> NDArray:
    """An attribute of all items of a collection of Blender's as an array (N, *each) of a type."""
    values: NDArray = np.empty((len(collection), *each), kind)
    collection.foreach_get(name, values.ravel())
    return values


@contextlib.contextmanager
def set_within(*settings: tuple[Any, str, Any]) -> Iterator[None]:
    """Within: attributes (owner, name, value) have these values; afterwards their own again."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in settings]
    try:
        for owner, name, value in settings:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)


@contextlib.contextmanager
def nothing_selected() -> Iterator[None]:
    """Within: no object is selected to begin with; afterwards the selection and the active object are as before."""
    layer = bpy.context.view_layer
    active, selected = layer.objects.active, list(layer.objects.selected)
    for thing in selected:
        thing.select_set(False)
    try:
        yield
    finally:
        for thing in selected:
            thing.select_set(True)
        layer.objects.active = active


def rendered(objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """Those of ``objects`` that renders of the present view layer show, whatever the viewport hides."""
    shown = rendered_by(bpy.context.view_layer)
    return [thing for thing in objects if thing in shown]


def rendered_by(view_layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """The objects that renders of a view layer show: those of its collections, unless hidden by themselves."""
    return _rendered(view_layer.layer_collection)


def _rendered(layer: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    if layer.collection.hide_render:
        return set()
    own = set() if layer.exclude else {thing for thing in layer.collection.objects if not thing.hide_render}
    return own.union(*(_rendered(child) for child in layer.children))


def layers_below(layer: bpy.types.LayerCollection) -> list[bpy.types.LayerCollection]:
    """A view layer's entry of a collection, and of all collections within."""
    return [layer, *(deeper for child in layer.children for deeper in layers_below(child))]


@contextlib.contextmanager
def unhidden(things: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Within: the viewport shows ``things``, objects that renders show; only what it shows can be read."""
    blocks: list[bpy.types.bpy_struct] = [thing for thing in things if thing.hide_viewport]
    for layer in layers_below(bpy.context.view_layer.layer_collection):
        off = [block for block in (layer, layer.collection) if block.hide_viewport]
        if off and not set(things).isdisjoint(layer.collection.all_objects):
            blocks += off
    eyes = [thing for thing in things if thing.hide_get()]

    def hide(hidden: bool) -> None:
        for thing in eyes:
            thing.hide_set(hidden)
        for block in blocks:
            block.hide_viewport = hidden

    try:
        hide(False)
        yield
    finally:
        hide(True)
