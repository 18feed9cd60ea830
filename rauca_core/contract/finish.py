"""Finishes of the paint: what of a surface's look no camouflage changes, and what rain does to it."""

from __future__ import annotations

from dataclasses import dataclass

from .errors import RaucaError
from .vehicle import Material

COAT_IOR = 1.5
FILM_ROUGHNESS = 0.16  # of a thin film of water that follows the surface below it
WALL_SHARE = 0.35  # how wet a vertical face gets in the weather that soaks a horizontal one


@dataclass(frozen=True)
class Finish:
    """Numbers of a Principled BSDF that shape the paint's reflections.

    Attributes:
        roughness, specular: of the painted layer; specular 0.5 reflects 4 % head-on, as plastic against air.
        coat: share of the surface under lacquer of refractive index :data:`COAT_IOR`.
        coat_roughness: of the lacquer; 0.03 is Blender's own.
    """

    roughness: float
    specular: float
    coat: float
    coat_roughness: float = 0.03


NAMED = {
    # Solid color under clearcoat. The lacquer covers all of it (coat 1) and is polished: the sun's image in it is
    # sharp. Binder and lacquer have nearly one refractive index, so the colored layer itself has only a faint, wide
    # gloss left (specular 0.1, roughness 0.5).
    "car_paint": Finish(roughness=0.5, specular=0.1, coat=1.0),
    # Printed matte vinyl wrap: no lacquer; a matte film keeps under a tenth of a polished surface's gloss at 60
    # degrees, which takes a roughness about 0.7; its structured face also halves the mirror-like part.
    "sticker": Finish(roughness=0.7, specular=0.25, coat=0.0),
}


def finish_of(material: Material, name: str) -> Finish:
    """A paint material's finish: its own numbers for ``own``, else those of a name.

    Raises:
        RaucaError: there is no finish of that name.
    """
    if name == "own":
        return Finish(material.roughness, 0.5, material.coat)
    if name not in NAMED:
        raise RaucaError(f"finish must be one of own, {', '.join(NAMED)}, not {name!r}")
    return NAMED[name]
