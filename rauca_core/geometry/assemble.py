"""What procedural vehicles are made of, and from parts to a vehicle: welded, on the ground, shaded and unwrapped."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Material, Vehicle
from ..contract.assets import assets_folder
from .mesh import MeshParts, crease_normals
from .unwrap import unwrap

PAINT = Material("paint", "paint", (0.26, 0.26, 0.26), roughness=0.35, coat=0.6)
GLASS = Material("glass", "glass", (0.012, 0.014, 0.018), roughness=0.04)
GAP = Material("gap", "trim", (0.004, 0.004, 0.004), roughness=0.8)
TYRE = Material("tyre", "tyre", (0.012, 0.012, 0.012), roughness=0.8)
DARK = Material("dark", "other", (0.012, 0.012, 0.014), roughness=0.5)
STEEL = Material("steel", "rim", (0.62, 0.63, 0.65), roughness=0.2, metallic=1.0)

CAR = [
    PAINT,
    GLASS,
    Material("trim", "trim", (0.018, 0.018, 0.020), roughness=0.5),
    GAP,
    Material("underbody", "other", (0.006, 0.006, 0.006), roughness=0.9),
    TYRE,
    Material("rim", "rim", (0.55, 0.56, 0.58), roughness=0.25, metallic=0.9),
    Material("dark", "other", (0.008, 0.008, 0.008), roughness=0.6),
    Material("disc", "other", (0.20, 0.20, 0.20), roughness=0.35, metallic=0.8),
    Material("headlamp", "headlamp", (0.80, 0.83, 0.87), roughness=0.08, coat=0.5),
    Material("taillamp", "taillamp", (0.36, 0.006, 0.010), roughness=0.12, coat=0.5),
    Material("chrome", "rim", (0.70, 0.70, 0.72), roughness=0.12, metallic=1.0),
    Material("mirror", "trim", (0.03, 0.03, 0.032), roughness=0.25),
    Material("grille", "trim", (0.010, 0.010, 0.011), roughness=0.35),
    Material("lens", "other", (0.20, 0.21, 0.22), roughness=0.06, coat=0.5),
    Material("reverse", "other", (0.55, 0.50, 0.50), roughness=0.10, coat=0.5),
    Material("reflector", "other", (0.30, 0.005, 0.008), roughness=0.15),
    Material("plate", "plate", (0.75, 0.75, 0.72), roughness=0.45),
    Material("ink", "other", (0.01, 0.01, 0.012), roughness=0.5),
]

SHAPE = [PAINT, Material("bare", "other", (0.05, 0.05, 0.05), roughness=0.8)]

BOAT = [
    PAINT,
    GLASS,
    Material("deck", "other", (0.33, 0.25, 0.16), roughness=0.7),
    Material("rubber", "trim", (0.018, 0.018, 0.020), roughness=0.6),
    DARK,
    STEEL,
    Material("wood", "other", (0.16, 0.09, 0.045), roughness=0.7),
    Material("engine", "trim", (0.022, 0.022, 0.024), roughness=0.3, coat=0.4),
    Material("seat", "other", (0.40, 0.38, 0.35), roughness=0.6),
]

AEROPLANE = [PAINT, GLASS, GAP, DARK, STEEL, TYRE]

CREASE_DEG = 38.0
GRID_M = 2.0**-16  # vertices are rounded to this, so that every machine hands xatlas the same bits
LICENCE = "Apache-2.0"


def read_profile(name: str) -> dict[str, Any]:
    """The profile tables of ``assets/vehicles/<name>.toml``."""
    return tomllib.loads(_profile(name).read_text(encoding="utf-8"))


def _profile(name: str) -> Path:
    return assets_folder() / "vehicles" / f"{name}.toml"


def assemble(
    name: str,
    category: str,
    parts: MeshParts,
    materials: Sequence[Material],
    central: Collection[str] = (),
) -> Vehicle:
    """Weld, place, shade and unwrap a vehicle; deterministic.

    It is moved so that its bounding box is centered over the origin and stands on z = 0.

    Args:
        parts: faces named ``material`` or ``material/panel``; a painted panel is cut from all others in the UV atlas.
        materials: those that ``parts`` name, and perhaps more.
        central: panels that straddle the plane y = 0 whole; every other one is two, left and right.

    Raises:
        RaucaError: see :func:`unwrap`.
        ImportError: xatlas is not installed.
    """
    profile = _profile(name)
    positions, triangles, names = parts.welded()
    positions = positions - [_middle(positions[:, 0]), _middle(positions[:, 1]), positions[:, 2].min()]
    positions = np.round(positions / GRID_M) * GRID_M
    kinds, _, panels = np.char.partition(names, "/").T
    used = [material for material in materials if material.name in kinds]
    index = {material.name: i for i, material in enumerate(used)}
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
        source=f"rauca procedural {name}" + (f" (assets/vehicles/{profile.name})" if profile.is_file() else ""),
        licence=LICENCE,
    )
    left = (positions[triangles][..., 1].sum(axis=1) > 0) & ~np.isin(panels, list(central))
    groups = np.unique(np.char.add(panels, np.where(left, " left", "")), return_inverse=True)[1]
    return unwrap(vehicle, groups=groups)


def _middle(values: NDArray[np.float64]) -> float:
    """Half way between the least and the greatest; exactly 0 when they mirror each other."""
    return float(np.ptp(values) / 2 + values.min())
