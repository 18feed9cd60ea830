"""Another UV layer for a vehicle's paint, for baking into."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .mesh_edits import require_own_faces
from .smart_project import smart_project
from .surface import Surface

LAYER = "baked"


def add_layer(surface: Surface) -> str:
    """Lay the paint out by Blender's Smart UV Project in a new UV layer; returns its name. Active layers stay so.

    Raises:
        RaucaError: a mesh that cannot be written to, or has no room for another layer; nothing was changed.
    """
    pieces = surface.painted_pieces()
    require_own_faces(piece for piece, _ in pieces)
    full = [piece.owner.name for piece, _ in pieces if len(piece.owner.data.uv_layers) >= 8]
    if full:
        raise contract.RaucaError(f"{full[0]}: has 8 UV layers, Blender's most; remove one")
    taken = {layer.name for piece, _ in pieces for layer in piece.owner.data.uv_layers}
    name = next(n for n in (LAYER, *(f"{LAYER}.{i:03}" for i in range(1, 100))) if n not in taken)
    uvs = np.zeros_like(surface.vehicle.uvs)
    uvs[surface.paint] = smart_project(surface.vehicle)
    for piece, span in pieces:
        paint = surface.paint[span]
        _write(piece.owner.data, name, piece.loops[paint], uvs[span][paint])
    return name


def _write(mesh: bpy.types.Mesh, name: str, loops: NDArray[np.int32], uvs: NDArray[np.float32]) -> None:
    active = mesh.uv_layers.active
    shown = active.name if active is not None else ""
    layer = mesh.uv_layers.new(name=name, do_init=False)
    values = np.zeros((len(mesh.loops), 2), np.float32)
    values[loops.ravel()] = uvs.reshape(-1, 2)
    layer.uv.foreach_set("vector", values.ravel())
    if shown:
        mesh.uv_layers.active = mesh.uv_layers[shown]
    mesh.update()
