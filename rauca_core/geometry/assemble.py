"""From parts to a vehicle: welded, on the ground, shaded and unwrapped."""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from ..contract import Material, Vehicle
from ..contract.assets import assets_folder
from ..contract.schema import Fields
from .mesh import MeshParts, Points, crease_normals
from .unwrap import unwrap

CREASE_DEG = 38.0
GRID_M = 2.0**-16  # vertices are rounded to this, so that every machine hands xatlas the same bits
LICENCE = "Apache-2.0"


def read_profile(name: str) -> dict[str, Any]:
    """The profile tables of ``assets/vehicles/<name>.toml``."""
    return tomllib.loads(_profile(name).read_text(encoding="utf-8"))


def _profile(name: str) -> Path:
    return assets_folder() / "vehicles" / f"{name}.toml"


def assemble(name: str, category: str, parts: MeshParts, central: Collection[str] = ()) -> Vehicle:
    """Weld, place, shade and unwrap a vehicle; deterministic.

    It is moved so that its bounding box is centered over the origin and stands on z = 0.

    Args:
        parts: faces named ``material``, of ``assets/vehicles/materials.toml``, or ``material/panel``; a painted panel
            is cut from all others in the UV atlas.
        central: panels that straddle the plane y = 0 whole; every other one is two, left and right.

    Raises:
        RaucaError: see :func:`unwrap`.
        ImportError: xatlas is not installed.
    """
    positions, triangles, names = parts.welded()
    positions = positions - [_middle(positions[:, 0]), _middle(positions[:, 1]), positions[:, 2].min()]
    positions = np.round(positions / GRID_M) * GRID_M
    kinds, _, panels = np.char.partition(names, "/").T
    listed = {kind: {"name": kind, **row} for kind, row in read_profile("materials")[category].items() if kind in kinds}
    used = [Material.from_json(Fields(row, f"materials.toml: {kind}")) for kind, row in listed.items()]
    index = {kind: i for i, kind in enumerate(listed)}
    vehicle = Vehicle(
        name=name,
        category=category,
        positions=positions.astype(np.float32),
        triangles=triangles,
        uvs=np.zeros((len(triangles), 3, 2), np.float32),
        normals=crease_normals(positions, triangles, CREASE_DEG),
        material=np.array([index[kind] for kind in kinds], np.int16),
        materials=used,
        paint_mask=np.zeros((1, 1), np.uint8),
        source=f"rauca procedural {name}" + (f" (assets/vehicles/{name}.toml)" if _profile(name).is_file() else ""),
        licence=LICENCE,
    )
    left = (positions[triangles][..., 1].sum(axis=1) > 0) & ~np.isin(panels, list(central))
    groups = np.unique(np.char.add(panels, np.where(left, " left", "")), return_inverse=True)[1]
    return unwrap(vehicle, groups=groups)


def _middle(values: Points) -> float:
    """Half way between the least and the greatest; exactly 0 when they mirror each other."""
    return float(np.ptp(values) / 2 + values.min())
