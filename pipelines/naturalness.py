"""Options that ask for a natural camouflage, as `rauca optimize` and `rauca tradeoff` take them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import ValidationError

from rauca_core.contract import RaucaError

if TYPE_CHECKING:
    from rauca_core.attack.naturalness import Naturalness

look_option = partial(typer.Option, rich_help_panel="What the paint looks like")
PaletteOption = Annotated[
    str | None,
    look_option("--palette", help="only these colors: #rrggbb,#rrggbb,..., a text file of them, or a photograph"),
]
PaletteColors = Annotated[int, look_option("--palette-colors", help="to take from a photograph given as palette")]
FeatureSize = Annotated[
    float | None, look_option("--feature-size", help="smallest patch of one color on the vehicle, centimetres")
]
Symmetric = Annotated[
    bool | None,
    look_option("--symmetric/--asymmetric", help="left and right alike: a view of one side teaches both"),
]
Reference = Annotated[
    str | None,
    look_option("--reference", help="what to look like: a photograph, a camouflage's .json, or a color #rrggbb"),
]
ReferenceWidth = Annotated[
    float, look_option("--reference-width", help="of a photograph on the vehicle, metres; 0: the image is a UV map")
]
ReferenceWeight = Annotated[
    float, look_option("--reference-weight", help="of the mean CIELAB distance from the reference in the loss")
]
MaxDeltaE = Annotated[
    float | None, look_option("--max-delta-e", help="nowhere farther from the reference than this, in CIELAB")
]
OPTIONS = {"feature_cm": "--feature-size", "max_delta_e": "--max-delta-e", "reference_width_m": "--reference-width"}


def make_naturalness(
    palette: str | None = None,
    palette_colors: int = 4,
    feature_size: float | None = None,
    reference: str | None = None,
    reference_width: float = 2.0,
    max_delta_e: float | None = None,
) -> Naturalness | None:
    """What the options ask for, None where they ask for nothing; raises :class:`RaucaError` naming a bad one."""
    from rauca_core.attack.naturalness import Naturalness
    from rauca_core.attack.naturalness.palette import read_palette
    from rauca_core.attack.naturalness.reference import fingerprint

    try:
        wanted = Naturalness(
            palette=read_palette(palette, palette_colors) if palette else (),
            feature_cm=feature_size,
            reference=reference,
            reference_sha256=fingerprint(reference) if reference else None,
            reference_width_m=reference_width or None,
            max_delta_e=max_delta_e,
        )
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else ""
        raise RaucaError(f"{OPTIONS.get(name, name)} {first.get('input')}: {first['msg'].lower()}") from None
    return None if wanted.empty else wanted


def natural_settings(context: typer.Context) -> dict[str, Any]:
    """The optimizer's settings that the command's options of this module amount to; a method's symmetry stays."""
    from rauca_core.attack.methods import method_named
    from rauca_core.attack.naturalness import Naturalness

    given = context.params
    names = ("palette_colors", "feature_size", "reference", "reference_width", "max_delta_e")
    wanted = make_naturalness(given["palette_of"], **{name: given[name] for name in names})
    weight = given["reference_weight"]
    if weight < 0 or (weight and given["reference"] is None):
        raise RaucaError(f"--reference-weight {weight:g}: give 0 or more, and a --reference")
    if weight and given["method"] in ("das", "active"):
        raise RaucaError(f"--reference-weight: {given['method']} has a prior of its own; use another --method")
    own = method_named(given["method"]).settings.get("natural")
    sides = given.get("symmetric")
    if own is not None and (wanted is not None or sides is not None):
        wanted = (wanted or own).model_copy(update={"symmetric": own.symmetric if sides is None else sides})
    elif sides:
        wanted = (wanted or Naturalness()).model_copy(update={"symmetric": True})
    chosen: dict[str, Any] = {} if wanted is None else {"natural": None if wanted.empty else wanted}
    return chosen | ({"prior": "reference", "gamma": weight} if weight else {})
