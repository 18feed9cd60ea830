"""The procedural cars: profile tables in, a painted and unwrapped vehicle out."""

from __future__ import annotations

import tomllib
from typing import Any

from ..contract import Vehicle
from ..contract.assets import assets_folder
from .assemble import assemble
from .car_body import Body
from .car_panels import SCREEN_LINE, add_skin
from .car_parts import add_mirror, add_plate, add_roof_rail, add_wheel
from .car_trim import add_trim
from .materials import CAR
from .mesh import MeshParts
from .solids import add_box

CARS = ("sedan", "hatchback", "suv", "van")
CENTRAL_PANELS = ("nose", "tail", "bonnet", "roof", "boot")


def build_car(name: str) -> Vehicle:
    """Build, unwrap and name the car of ``assets/vehicles/<name>.toml``; deterministic."""
    profile = read_profile(name)
    half = MeshParts()
    body = Body(profile)
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
    whole = MeshParts()
    whole.extend(half)
    whole.extend(half.mirrored())
    for plate, facing in (("front_plate", 1), ("rear_plate", -1)):
        x, z = details[plate]
        add_plate(whole, x, z, facing)
    source = f"rauca procedural {name} (assets/vehicles/{name}.toml)"
    return assemble(name, "car", whole, CAR, source, CENTRAL_PANELS)


def read_profile(name: str) -> dict[str, Any]:
    """The profile tables of ``assets/vehicles/<name>.toml``."""
    return tomllib.loads((assets_folder() / "vehicles" / f"{name}.toml").read_text(encoding="utf-8"))
