"""The procedural sedan: profile tables in, a painted and unwrapped vehicle out."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np

from ..contract import Material, Vehicle
from ..contract.assets import assets_folder
from .mesh import MeshParts, crease_normals
from .sedan_body import Body
from .sedan_parts import add_box, add_mirror, add_plate, add_wheel
from .sedan_trim import add_trim
from .unwrap import unwrap

CREASE_DEG = 38.0
CENTRAL_PANELS = ("nose", "tail", "bonnet", "roof", "boot")
GRID_M = 2.0**-16  # vertices are rounded to this, so that every machine hands xatlas the same bits
MATERIALS = [
    Material("paint", "paint", (0.26, 0.26, 0.26), roughness=0.35, coat=0.6),
    Material("glass", "glass", (0.012, 0.014, 0.018), roughness=0.04),
    Material("trim", "trim", (0.018, 0.018, 0.020), roughness=0.5),
    Material("gap", "trim", (0.004, 0.004, 0.004), roughness=0.8),
    Material("underbody", "other", (0.006, 0.006, 0.006), roughness=0.9),
    Material("tyre", "tyre", (0.012, 0.012, 0.012), roughness=0.8),
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


def build_sedan() -> Vehicle:
    """Build, unwrap and name the sedan; deterministic."""
    profile = read_profile()
    half = MeshParts()
    body = Body(profile)
    half.extend(body.parts())
    add_trim(half, body)
    for x in (profile["wheels"]["front_x"], profile["wheels"]["rear_x"]):
        add_wheel(half, profile["wheels"], x)
    add_mirror(half)
    for x in (0.02, -0.96):
        add_box(half, (x, 0.905, 0.795), (0.17, 0.030, 0.024), "chrome", 0.008)
    whole = MeshParts()
    whole.extend(half)
    whole.extend(half.mirrored())
    add_plate(whole, 2.335, 0.485, 1)
    add_plate(whole, -2.300, 0.800, -1)
    positions, triangles, names = whole.welded()
    positions = positions - [np.ptp(positions[:, 0]) / 2 + positions[:, 0].min(), 0.0, positions[:, 2].min()]
    positions = np.round(positions / GRID_M) * GRID_M
    panels, sides = np.char.partition(names, "/")[:, 2], positions[triangles][..., 1].sum(axis=1) > 0
    names = np.char.partition(names, "/")[:, 0]
    index = {material.name: i for i, material in enumerate(MATERIALS)}
    vehicle = Vehicle(
        name="sedan",
        positions=positions.astype(np.float32),
        triangles=triangles,
        uvs=np.zeros((len(triangles), 3, 2), np.float32),
        normals=crease_normals(positions, triangles, CREASE_DEG),
        material=np.array([index[name] for name in names], np.int16),
        materials=MATERIALS,
        paint_mask=np.zeros((1, 1), np.uint8),
        source="rauca procedural sedan (assets/vehicles/sedan.toml)",
        licence="Apache-2.0",
    )
    whole_panels = np.isin(panels, CENTRAL_PANELS)
    groups = np.unique(np.char.add(panels, np.where(whole_panels | ~sides, "", " left")), return_inverse=True)[1]
    return unwrap(vehicle, groups=groups)


def read_profile() -> dict[str, Any]:
    """The profile tables of ``assets/vehicles/sedan.toml``."""
    return tomllib.loads((assets_folder() / "vehicles" / "sedan.toml").read_text(encoding="utf-8"))
