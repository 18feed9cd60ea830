"""Camouflage that people could paint and would pass by: few colors, patches of a size, close to a reference.

The paper names naturalness as its first limitation. Each constraint is one module and works with every other; the free
parameters stay colors in [0, 1], so that the optimizer, its limits and its checkpoints know nothing of it.
"""

from __future__ import annotations

import re

from pydantic import Field, model_validator

from ...contract import RaucaError
from ...runtime.settings import Settings

_HEX = re.compile(r"#[0-9a-fA-F]{6}")


class Naturalness(Settings):
    """Constraints on the paint, in any combination; part of ``OptimizerSettings``.

    Attributes:
        palette: the only colors that the map may hold, ``#rrggbb``, sRGB; empty for no such constraint.
        feature_cm: every patch of one color holds a disc of this diameter on the vehicle, unless the paint ends there.
        symmetric: left and right of the vehicle look alike: a view of one side teaches both.
        reference: an image, a camouflage's ``.json`` or a color ``#rrggbb``: what the paint should look like.
        reference_sha256: of its contents, so that a resumed run notices another picture.
        reference_width_m: how wide a photograph lies on the vehicle; None takes the image for a UV map.
        max_delta_e: nowhere is the paint farther than this from the reference: Euclidean distance in CIELAB (1976).
    """

    palette: tuple[str, ...] = ()
    feature_cm: float | None = Field(default=None, gt=0, le=100_000)
    symmetric: bool = False
    reference: str | None = None
    reference_sha256: str | None = None
    reference_width_m: float | None = Field(default=2.0, gt=0, le=1000)
    max_delta_e: float | None = Field(default=None, ge=0, le=1000)

    @model_validator(mode="after")
    def _check(self) -> Naturalness:
        for color in self.palette:
            parse_color(color, "--palette")
        if len(set(self.palette)) != len(self.palette):
            raise RaucaError("--palette: a color is given twice; give each once")
        if self.max_delta_e is not None and self.reference is None:
            raise RaucaError("--max-delta-e: a distance to what? give a --reference")
        return self

    @property
    def empty(self) -> bool:
        """Whether nothing is asked of the paint; a reference alone is measured against, and asks nothing."""
        return not self.palette and self.feature_cm is None and not self.symmetric and self.reference is None


def parse_color(text: str, option: str) -> tuple[int, int, int]:
    """``#rrggbb`` as 8-bit sRGB; raises :class:`RaucaError` naming the option."""
    if not _HEX.fullmatch(text):
        raise RaucaError(f"{option} {text}: not a color; write #rrggbb, such as #4b5320")
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


def is_color(text: str) -> bool:
    return text.startswith("#")
