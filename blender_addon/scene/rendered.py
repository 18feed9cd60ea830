"""Which objects renders show, whatever the viewport hides."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import bpy


def rendered(objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """Those of ``objects`` that renders of the present view layer show."""
    shown = rendered_by(bpy.context.view_layer)
    return [thing for thing in objects if thing in shown]


def rendered_by(view_layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """The objects that renders of a view layer show: those of its collections, unless hidden by themselves."""
    return _rendered(view_layer.layer_collection)


def layers_below(layer: bpy.types.LayerCollection) -> list[bpy.types.LayerCollection]:
    """A view layer's entry of a collection, and of all collections within."""
    return [layer, *(deeper for child in layer.children for deeper in layers_below(child))]


@contextlib.contextmanager
def unhidden(things: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Within: the viewport shows ``things``, objects that renders show; only what it shows can be read."""
    view_layer = bpy.context.view_layer
    blocks: list[bpy.types.bpy_struct] = [thing for thing in things if thing.hide_viewport]
    for layer in layers_below(view_layer.layer_collection):
        off = [block for block in (layer, layer.collection) if block.hide_viewport]
        if off and not set(things).isdisjoint(layer.collection.all_objects):
            blocks += off
    eyes = [thing for thing in things if thing.hide_get()]
    try:
        _hide(blocks, eyes, False)
        yield
    finally:
        _hide(blocks, eyes, True)


def _hide(blocks: list[bpy.types.bpy_struct], eyes: list[bpy.types.Object], hidden: bool) -> None:
    for thing in eyes:
        thing.hide_set(hidden)
    for block in blocks:
        block.hide_viewport = hidden


def _rendered(layer: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    if layer.collection.hide_render:
        return set()
    own = set() if layer.exclude else {thing for thing in layer.collection.objects if not thing.hide_render}
    return own.union(*(_rendered(child) for child in layer.children))
