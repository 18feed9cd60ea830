"""The finished camouflage: an 8-bit UV map anyone can load, and how it was made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch import Tensor

from ..contract import Camouflage, RaucaError, Vehicle, save_camouflage
from ..contract.color import to_bytes
from ..contract.files import png_bytes
from ..render import Pyramid, linear_to_srgb, srgb_to_linear
from .journal import CURVES, HISTORY, read_history
from .naturalness.finish import finish
from .naturalness.texture import NaturalColors
from .settings import OptimizerSettings
from .texture import Texture

AVERAGED_STEPS = 50


def map_png(pyramid: Pyramid, texels_srgb: Tensor) -> bytes:
    """Texels (P, 3) sRGB as the PNG of a UV map, gutters filled so that no filter bleeds foreign color."""
    uv_map = linear_to_srgb(pyramid.to_map(srgb_to_linear(texels_srgb.detach().cpu())))
    return png_bytes(to_bytes(uv_map.permute(1, 2, 0).numpy()))


def write_result(
    out: Path, vehicle: Vehicle, pyramid: Pyramid, texture: Texture, settings: OptimizerSettings, detector: str
) -> Path:
    """Write ``camouflage.json`` and ``.png`` into ``out``; losses are means over the last steps of the history.

    Raises:
        RaucaError: a history without a step, or damaged.
    """
    last = read_history(out)[-AVERAGED_STEPS:]
    if not last:
        raise RaucaError(f"{out / HISTORY}: holds no step of the run; bring it back, or start anew in another folder")
    losses = {name: sum(r[name] for r in last) / len(last) for name in CURVES}
    made: dict[str, Any] = {
        "detector": detector,
        "steps": settings.steps,
        "seed": settings.seed,
        "final_losses": losses,
        "settings": settings.identity(),
    }
    if isinstance(texture, NaturalColors):
        uv_map, made["natural"] = finish(texture.constraints, texture.texels())
        png = png_bytes(uv_map)
    else:
        png = map_png(pyramid, texture.texels())
    camouflage = Camouflage(settings.name, vehicle.name, vehicle.atlas_id, settings.map_size, settings.method, made)
    path = out / "camouflage.json"
    save_camouflage(path, camouflage, png)
    return path
