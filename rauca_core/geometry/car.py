"""The procedural cars: profile tables in, a painted and unwrapped vehicle out."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..contract import Vehicle
from .assemble import assemble, read_profile
from .car_body import SCREEN_LINE, CarBody, add_skin
from .mesh import MeshParts, Points
from .solids import add_box, add_tube, lathe

CARS = ("sedan", "hatchback", "suv", "van")
CENTRAL_PANELS = ("nose", "tail", "bonnet", "roof", "boot")
RAIL_LIFT_M = 0.05


def build_car(name: str) -> Vehicle:
    """Build, unwrap and name the car of ``assets/vehicles/<name>.toml``; deterministic."""
    profile = read_profile(name)
    half = MeshParts()
    body = CarBody(profile)
    add_skin(half, body)
    add_trim(half, body)
    for x in (profile["wheels"]["front_x"], profile["wheels"]["rear_x"]):
        add_wheel(half, profile["wheels"], x)
    details = profile["details"]
    add_mirror(half, details["mirror"])
    for x, y, z in details["handles"]:
        add_box(half, (x, y, z), (0.17, 0.030, 0.024), details["handle_material"], 0.008)
    if "roof_rail" in details:
        add_roof_rail(half, body.deck_line(SCREEN_LINE), details["roof_rail"])
    whole = half.both_sides()
    for plate, facing in (("front_plate", 1), ("rear_plate", -1)):
        x, z = details[plate]
        add_plate(whole, x, z, facing)
    return assemble(name, "car", whole, CENTRAL_PANELS)


def add_wheel(parts: MeshParts, wheels: dict[str, Any], x: float) -> None:
    """Add a left wheel: tyre, rim with five double spokes, brake disc."""
    radius, rim, width = wheels["radius"], wheels["rim_radius"], wheels["width"] / 2
    center = np.array([x, wheels["half_track"], radius])
    wall = radius - rim
    shoulder, tread = radius - 0.28 * wall, radius - 0.06 * wall
    tyre_radius = [rim - 0.01, rim + 0.3 * wall, shoulder, tread, radius, radius]
    tyre_radius += [tread, shoulder, rim + 0.3 * wall, rim + 0.05 * wall, rim]
    tyre_across = [-width * 0.86, -width, -width * 0.98, -width * 0.80, -width * 0.60, width * 0.60]
    tyre_across += [width * 0.80, width * 0.98, width, width * 0.93, width * 0.86]
    tyre = np.column_stack([tyre_radius, tyre_across])
    parts.grid(lathe(tyre, 48) + center, "tyre", flip=True)
    lip_radius = [rim + 0.004, rim + 0.004, rim - 0.012, rim - 0.022, rim - 0.03, rim - 0.03]
    lip_across = [width * 0.84, width * 0.95, width * 0.96, width * 0.86, width * 0.2, -width * 0.3]
    lip = np.column_stack([lip_radius, lip_across])
    parts.grid(lathe(lip, 48) + center, "rim", flip=True)
    disc = np.array([[rim - 0.03, -width * 0.3], [0.16, -width * 0.28], [0.0, -width * 0.25]])
    parts.grid(lathe(disc, 48) + center, "dark", flip=True)
    brake = np.array([[0.155, width * 0.0], [0.15, width * 0.05], [0.085, width * 0.05]])
    parts.grid(lathe(brake, 32) + center, "disc", flip=True)
    hub = np.array([[0.075, 0.0], [0.072, width * 0.66], [0.045, width * 0.78], [0.0, width * 0.80]])
    parts.grid(lathe(hub, 24) + center, "rim", flip=True)
    for k in range(5):
        for lean in (-1, 1):
            _add_spoke(parts, center, 2 * np.pi * k / 5 + np.pi / 2, lean, rim, width)


def _add_spoke(parts: MeshParts, center: Points, angle: float, lean: int, rim: float, width: float) -> None:
    """One blade of a double spoke, from the hub to the rim's lip."""
    along = np.linspace(0.055, rim - 0.012, 5)
    t = (along - along[0]) / (along[-1] - along[0])
    middle = lean * (0.020 + 0.030 * t)
    half = 0.017 - 0.002 * t
    face = width * (0.78 + 0.12 * t)
    back, edge = face - 0.030, face - 0.008
    sides, narrowed = np.array([-1, -1, -1, 1, 1, 1]), np.array([1.0, 1.0, 0.7, 0.7, 1.0, 1.0])
    radial, across = along[:, None], middle[:, None] + sides * half[:, None] * narrowed
    out = np.stack([back, edge, face, face, edge, back], axis=1)
    c, s = np.cos(angle), np.sin(angle)
    points = np.stack([radial * c - across * s, out, radial * s + across * c], axis=-1) + center
    parts.grid(points, "rim", flip=True)


def add_mirror(parts: MeshParts, center: list[float]) -> None:
    """The left mirror: a rounded housing around ``center`` on a stalk, its glass to the rear."""
    around = np.linspace(0, 2 * np.pi, 25)
    around[-1] = 0.0
    depth = np.array([-0.055, -0.060, -0.045, -0.010, 0.030, 0.055, 0.066])
    scale = np.array([0.0, 0.86, 1.0, 1.0, 0.86, 0.55, 0.0])
    cosine, sine = np.cos(around), np.sin(around)
    y = np.sign(cosine) * np.abs(cosine) ** 0.6 * 0.105
    z = np.sign(sine) * np.abs(sine) ** 0.7 * 0.066
    points = np.stack(
        [np.broadcast_to(depth[:, None], (7, 25)), scale[:, None] * y, scale[:, None] * z], axis=-1
    ) + np.array(center)
    names = np.full((6, 24), "mirror", dtype="U32")
    names[0] = "glass"
    parts.grid(points, names, flip=True)
    x, y, z = center
    add_box(parts, (x + 0.01, y - 0.10, z - 0.05), (0.06, 0.12, 0.03), "trim", 0.008)


def add_roof_rail(parts: MeshParts, roof: Points, span: list[float]) -> None:
    """A rail over the roof's line ``roof`` (N, 3), front to rear, between two places ``span`` along x."""
    x = np.linspace(span[0], span[1], 15)
    path = np.stack([x, *(np.interp(-x, -roof[:, 0], roof[:, i]) for i in (1, 2))], axis=-1)
    path[1:-1, 2] += RAIL_LIFT_M * np.minimum(1, 0.7 + 0.3 * np.minimum(np.arange(13), np.arange(13)[::-1]))
    add_tube(parts, path, 0.016, "trim")


def add_plate(parts: MeshParts, x: float, z: float, facing: int) -> None:
    """A number plate in its frame with seven dark characters; ``facing`` +1 forward, -1 backward."""
    add_box(parts, (x, 0, z), (0.02, 0.54, 0.13), "trim", 0.006)
    add_box(parts, (x + facing * 0.008, 0, z), (0.012, 0.515, 0.108), "plate", 0.003)
    for k in range(7):
        y = (k - 3) * 0.064 + (0.018 if k > 2 else -0.012)
        add_box(parts, (x + facing * 0.0145, y, z), (0.002, 0.034, 0.068), "ink")


def add_trim(parts: MeshParts, body: CarBody) -> None:
    """Add the left half of the strips and the exhaust."""
    details = body.profile["details"]
    for material, start, stop, low, high, lift in details["nose"]:
        parts.grid(body.ribbon((start, stop), (low, high), lift), material)
        _close(parts, body.ribbon((start, stop), (low, high), lift), material)
    for material, start, stop, low, high, lift in details["tail"]:
        strip = body.ribbon((body.tail_place - stop, body.tail_place - start), (low, high), lift)
        parts.grid(strip, material)
        _close(parts, strip[::-1], material, flip=True)
    if "exhaust" in details:
        _add_exhaust(parts, body, *details["exhaust"])


def _add_exhaust(parts: MeshParts, body: CarBody, y: float, z: float) -> None:
    """A tail pipe through the bumper."""
    pipe = lathe(np.array([[0.0, 0.03], [0.030, 0.03], [0.034, 0.0], [0.038, 0.0], [0.038, 0.10]]), 24)
    x = body.skin(np.array([body.tail_place - y]), np.array([z + 0.015]))[0, 0]
    points = np.stack([pipe[..., 1] + x - 0.03, pipe[..., 0] * 1.3 + y, pipe[..., 2] + z], axis=-1)
    names = np.full((24, 4), "chrome", dtype="U32")
    names[:, 0] = "gap"
    parts.grid(points, names)


def _close(parts: MeshParts, strip: np.ndarray, material: str, flip: bool = False) -> None:
    """Close the strip's outer end."""
    end = strip[-1]
    corners = np.stack([end[[0, 1, 2]], end[[0, 2, 3]]])
    parts.triangles(corners if flip else corners[:, ::-1], material)
