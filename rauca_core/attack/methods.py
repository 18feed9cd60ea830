"""The methods that camouflages are compared by, each from its paper, as one table of settings of one optimizer.

What each paper leaves open, and what this framework does otherwise, stands in ``docs/methods.md``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..contract import RaucaError
from .naturalness import Naturalness


@dataclass(frozen=True)
class Method:
    """What is painted, what is made small, how frames are lit and augmented, and what keeps the paint smooth.

    Attributes:
        source: authors, title, venue and year.
        weathers: the data set that its authors would use: ``single``, ``base`` or ``enhanced``.
        settings: of `OptimizerSettings`, where they differ from its defaults.
    """

    source: str
    weathers: str
    settings: Mapping[str, Any]


# Facets through Neural Renderer, as it reads them; smoothness is taken on the picture.
_FACETS = {"paint": "facets", "samples": 2, "pixel_filter": "box", "roa": False, "smooth": "picture"}
# Published smoothness on the picture is a sum over its pixels, of 224 x 224 (DAS) and 640 x 640 (FCA); ours is a mean.
METHODS: Mapping[str, Method] = {
    # DAS: scatter the model's attention, spare people's; some panels are painted, over a seed picture.
    "das": Method(
        source="Wang, Liu, Yin, Liu, Tang, Liu: Dual Attention Suppression Attack, CVPR 2021",
        weathers="single",
        settings={
            **_FACETS,
            "cover": "panels",
            "start": "seed",
            "limit": "tanh",
            "objective": "attention",
            "light": "none",
            "beta": 1e-4 * 224**2,
            "prior": "seed",
            "gamma": 4e-4,
        },
    ),
    # FCA: facets all over the body, a detection loss of three terms, Neural Renderer's own light.
    "fca": Method(
        source="Wang, Jiang, Sun, Zhou, Gong, Zhang, Yao, Chen: FCA, AAAI 2022",
        weathers="single",
        settings={
            **_FACETS,
            "limit": "tanh",
            "objective": "three-terms",
            "light": "none",
            "beta": 1e-4 * 640**2,
        },
    ),
    # DTA: one small pattern, repeated all over, against the vehicle's confidence.
    "dta": Method(
        source="Suryanto, Kim, Kang, Larasati, Yun, Le, Yang, Oh, Kim: DTA, CVPR 2022",
        weathers="single",
        settings={
            "paint": "pattern",
            "pattern_side": 16,
            "tile_m": 0.5,
            "objective": "confidence",
            "roa": False,
            "smooth": "pattern",
            "beta": 0.0,
        },
    ),
    # ACTIVE: a triplanar pattern in the background's colors, against any class, under strong augmentation.
    "active": Method(
        source="Suryanto, Kim, Larasati, Kang, Le, Hong, Yang, Oh, Kim: ACTIVE, ICCV 2023",
        weathers="single",
        settings={
            "paint": "pattern",
            "pattern_side": 64,
            "tile_m": 1.0,
            "shift": 0.5,
            "objective": "stealth",
            "augmentation": "active",
            "smooth": "pattern",
            "beta": 0.25,
            "prior": "background",
            "gamma": 0.25,
        },
    ),
    # RAUCA-base, of the conference version: facets through Neural Renderer, lit like the frame, in several weathers.
    "rauca-base": Method(
        source="Zhou, Lyu, He, Li: RAUCA, ICML 2024",
        weathers="base",
        settings={**_FACETS, "limit": "clamp"},
    ),
    # RAUCA-final, the paper: the UV map itself, Eq. 4 to 8, under random output augmentation, in better weathers.
    "rauca-final": Method(
        source="Zhou, Lyu, He, Li: Toward Robust and Accurate Adversarial Camouflage Generation, 2025",
        weathers="enhanced",
        settings={"limit": "clamp"},
    ),
    # Ours: what this project adds to RAUCA-final to reach detectors and views that took no part.
    "ours": Method(
        source="this project",
        weathers="enhanced",
        settings={
            # Small scores push as hard as large ones: Eq. 6 lets go of a frame long before average precision does.
            "objective": "log-score",
            # Finer patches are no longer seen as such from 5 m on, and fit the frames at hand rather than new ones.
            "natural": Naturalness(feature_cm=5.0),
            "lr": 0.03,
            "decay": 0.03,
        },
    ),
}


def method_named(name: str) -> Method:
    """The method of that name; raises :class:`RaucaError` listing all when there is none."""
    if name not in METHODS:
        raise RaucaError(f"method: no {name!r}; choose one of {', '.join(METHODS)}")
    return METHODS[name]


def settings_of(name: str, /, **explicit: Any) -> dict[str, Any]:
    """What `make_settings` takes for a method; what is given explicitly wins, the camouflage's name included."""
    return {"name": name, **method_named(name).settings, **explicit, "method": name}
