"""The hard cases, by name: what the frames show and what the detector answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rauca_core.contract import Camera

from .detectors import Answer, as_found, elsewhere, endless, inside_out, nothing, points, saturated, sure, unseen
from .drawn import CENTER, Look, Maps, around

SIZE = 48  # pixels
LARGEST_HALF, SMALLEST_HALF = 65504.0, 6e-8  # of float16, as light maps are stored
MIDDLE = (0.25, 0.25, 0.75, 0.75)


@dataclass(frozen=True)
class HardCase:
    """One way to make a loss or a gradient infinite.

    Attributes:
        name: for tables and tests.
        about: what is hard, in a few words.
        look: how the frames are made.
        answer: what the detector makes of its predictions.
        learns: whether the attack has a gradient on the UV map.
        settings: of the optimizer, where they differ.
    """

    name: str
    about: str
    look: Look = field(default_factory=Look)
    answer: Answer = as_found
    learns: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)


def _from_afar(azimuth_deg: float, size: int) -> Camera:
    """So far away that the vehicle is about a pixel, and aimed half a pixel aside: onto one, not between four."""
    azimuth, distance_m = np.radians(azimuth_deg), 260.0
    eye = distance_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.1])
    half = distance_m / around(0.0, size).K[0, 0] / 2
    ahead = Camera.look_at(eye, np.array(CENTER), 45, size, size)
    return Camera.look_at(eye, np.array(CENTER) + half * (ahead.R[0] + ahead.R[1]), 45, size, size)


def _turned_away(azimuth_deg: float, size: int) -> Camera:
    eye = around(azimuth_deg, size).position
    return Camera.look_at(eye, 2 * eye - np.array(CENTER), 45, size, size)


def _cut_off(azimuth_deg: float, size: int) -> Camera:
    """The vehicle reaches into a corner of the picture by a few pixels."""
    ordinary = around(azimuth_deg, size)
    aside = ordinary.position + 9.0 * ordinary.R[2] + 4.5 * ordinary.R[0] + 3.2 * ordinary.R[1]
    return Camera.look_at(ordinary.position, aside, 45, size, size)


def _flat(A: float, B: float) -> Any:
    """Light of one strength on all paint, and behind it."""

    def light(paint: Maps, rest: Maps) -> tuple[Maps, Maps]:
        return np.where(paint > 0, np.float32(A), np.float32(0)), np.full_like(rest, B)

    return light


def _below_zero(A: Maps, B: Maps) -> tuple[Maps, Maps]:
    return A - np.float32(0.4), B


_AT = (SIZE / 4, SIZE / 4, SIZE * 3 / 4, SIZE * 3 / 4)  # the same in pixels
_STILL: Mapping[str, Any] = {"roa": False}  # the box stays where the detector has it

CASES = (
    HardCase("ordinary", "nothing hard, to compare with"),
    HardCase("empty mask", "no paint in the picture", Look(_turned_away, box=MIDDLE), learns=False),
    HardCase("one pixel", "the vehicle is a pixel", Look(_from_afar)),
    HardCase("cut off", "the augmentation moves the vehicle out of the picture", Look(_cut_off)),
    HardCase("no box area", "the true box is a point", Look(box=(0.5, 0.5, 0.5, 0.5)), learns=False),
    HardCase("black night", "A = B = 0", Look(light=_flat(0, 0)), learns=False),
    HardCase("fog", "A = 0: the paint cannot be seen", Look(light=_flat(0, 0.7)), learns=False),
    HardCase("blinding", "A and B at float16's largest", Look(light=_flat(LARGEST_HALF, LARGEST_HALF)), learns=False),
    HardCase("faint", "A at float16's smallest, B = 0", Look(light=_flat(SMALLEST_HALF, 0))),
    HardCase("negative light", "A below 0 in parts, from noise", Look(light=_below_zero)),
    HardCase("no boxes", "the detector returns none", answer=nothing, learns=False),
    HardCase("no detection", "every probability is exactly 0", answer=unseen, learns=False),
    HardCase("no overlap", "every box misses the vehicle", answer=elsewhere, learns=False),
    HardCase("certain", "confidence and overlap exactly 1, no slope", Look(box=MIDDLE), saturated(_AT), False, _STILL),
    HardCase(
        "certain, steep", "confidence and overlap exactly 1, and a slope", Look(box=MIDDLE), sure(_AT), True, _STILL
    ),
    HardCase("endless boxes", "boxes from minus to plus infinity", answer=endless),
    HardCase("inside out", "right edges left of left ones", answer=inside_out, learns=False),
    HardCase("points", "predicted boxes without area", answer=points, learns=False),
)
