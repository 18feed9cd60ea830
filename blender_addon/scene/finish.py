"""How the paint's surface reflects, whatever its color: the vehicle's own way, car paint, or a sticker.

Every finish is non-metallic under an untinted coat, so linear radiance stays affine in the color below it.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core import contract


@dataclass(frozen=True)
class Finish:
    """Inputs of a Principled BSDF that shape the paint's reflections.

    Attributes:
        roughness: of the colored surface.
        specular: its ``Specular IOR Level``; 0.5 reflects 4 % head-on, as plastic against air.
        coat, coat_roughness: weight and roughness of the clear layer on top, refractive index 1.5.
    """

    roughness: float
    specular: float
    coat: float
    coat_roughness: float


FINISHES = {
    # Solid color under clearcoat. The lacquer covers all of it (coat 1) and is polished: the sun's image in it is
    # sharp (roughness 0.03, Blender's own for a coat). Binder and lacquer have nearly one refractive index, so the
    # colored layer itself has only a faint, wide gloss left (specular 0.1, roughness 0.5).
    "car_paint": Finish(roughness=0.5, specular=0.1, coat=1.0, coat_roughness=0.03),
    # Printed matte vinyl wrap: no lacquer; a matte film keeps under a tenth of a polished surface's gloss at 60
    # degrees, which takes a roughness about 0.7; its structured face also halves the mirror-like part.
    "sticker": Finish(roughness=0.7, specular=0.25, coat=0.0, coat_roughness=0.03),
}


def finish_of(spec: contract.Material, name: str) -> Finish:
    """The finish of a paint material: its own numbers for ``own``, else those of ``car_paint`` or ``sticker``.

    Raises:
        RaucaError: there is no finish of that name.
    """
    if name == "own":
        return Finish(spec.roughness, 0.5, spec.coat, 0.03)
    if name not in FINISHES:
        raise contract.RaucaError(f"finish must be one of own, {', '.join(FINISHES)}, not {name!r}")
    return FINISHES[name]
