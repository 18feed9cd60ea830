"""The methods that camouflages are compared by, each from its paper, as one table of settings of one optimizer.

A rival has two forms: *published*, everything as its public code or paper says, and *adapted*, the same attack in exact
light, at the best of three learning rates in validation places (docs/results.md), and where it paints the UV map in our
renderer. What each paper leaves open stands in ``docs/methods.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

from ..contract import RaucaError
from .naturalness import Naturalness
from .settings import Fidelity, make_settings

Named = TypeVar("Named")


@dataclass(frozen=True)
class Method:
    """What is painted, what is made small, how frames are lit and augmented, and what keeps the paint smooth.

    Attributes:
        source: authors, title, venue and year.
        weathers: the data set that its authors would use: ``single``, ``base`` or ``enhanced``.
        known: what the published form follows: its public ``code``, or its ``paper`` where there is no code; empty for
            what was never published.
        settings: of `OptimizerSettings` in both forms, where they differ from its defaults.
        published, adapted: those of one form, over ``settings``.
        stand_ins: what of the published method this framework does otherwise in its published form, too.
        panel: detectors of the registry that it attacks where none is named.
        panel_size: ``detector_size`` of that panel where none is given.
    """

    source: str
    weathers: str
    known: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    published: Mapping[str, Any] = field(default_factory=dict)
    adapted: Mapping[str, Any] = field(default_factory=dict)
    stand_ins: str = ""
    panel: tuple[str, ...] = ("yolov3-tiny",)
    panel_size: int | None = None

    def attacked(self, named: Sequence[Named], size: int | None) -> tuple[Sequence[Named | str], int | None]:
        """What a run attacks, and its ``detector_size``: what is named, or else the panel at the panel's size."""
        return (named, size) if named else (self.panel, self.panel_size if size is None else size)


_NEURAL_RENDERER = {"samples": 2, "pixel_filter": "box"}
# Facets are read as Neural Renderer reads them in both forms: a cell is no texel, and finer subsamples of them cost
# eight times the taps at 4 x 4, beyond a computer's memory at our 12 x 12.
_FACETS = {**_NEURAL_RENDERER, "paint": "facets", "roa": False, "smooth": "picture"}
# Smoothness on the picture is a sum over its pixels there, of 224 x 224 (DAS) and 640 x 640 (FCA); ours is a mean.
METHODS: Mapping[str, Method] = {
    # DAS: scatter the model's attention, spare people's; some panels are painted, over a seed picture.
    "das": Method(
        source="Wang, Liu, Yin, Liu, Tang, Liu: Dual Attention Suppression Attack, CVPR 2021",
        weathers="single",
        known="code",
        settings={
            **_FACETS,
            "cover": "panels",
            "start": "seed",
            "limit": "tanh",
            "objective": "attention",
            "beta": 1e-4 * 224**2,
            "prior": "seed",
            "gamma": 4e-4,
        },
        published={"light": "none", "batch": 1},
        adapted={"lr": 0.16},
        stand_ins="attention is the attacked detector's, not a classifier's; the seed picture is ours",
    ),
    # FCA: facets all over the body, a detection loss of three terms, Neural Renderer's own light.
    "fca": Method(
        source="Wang, Jiang, Sun, Zhou, Gong, Zhang, Yao, Chen: FCA, AAAI 2022",
        weathers="single",
        known="code",
        settings={
            **_FACETS,
            "start": "tanh-unit",
            "limit": "tanh",
            "objective": "every-cell",
            "beta": 1e-4 * 640**2,
        },
        published={"light": "none", "batch": 1},
        adapted={"lr": 0.16},
        stand_ins="the boxes assigned to the vehicle are the nine that overlap it most, not those its anchors match",
    ),
    # DTA: one small pattern, repeated all over, against the vehicle's confidence.
    "dta": Method(
        source="Suryanto, Kim, Kang, Larasati, Yun, Le, Yang, Oh, Kim: DTA, CVPR 2022",
        weathers="single",
        known="paper",
        settings={
            "paint": "pattern",
            "pattern_side": 16,
            "tile_m": 0.5,
            "objective": "confidence",
            "roa": False,
            "smooth": "pattern",
            "beta": 0.0,
        },
        adapted={"lr": 0.04},
        stand_ins="exact light and projection for its transformation network; texels, rate and batch are ours",
    ),
    # ACTIVE: a triplanar pattern in the background's colors, against any class, under strong augmentation.
    "active": Method(
        source="Suryanto, Kim, Larasati, Kang, Le, Hong, Yang, Oh, Kim: ACTIVE, ICCV 2023",
        weathers="single",
        known="paper",
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
        stand_ins="exact light for its neural renderer; tile, palette, rate, batch and whether boxes move are ours",
    ),
    # RAUCA-base, of the conference version: facets through Neural Renderer, lit like the frame, in several weathers.
    "rauca-base": Method(
        source="Zhou, Lyu, He, Li: RAUCA, ICML 2024",
        weathers="base",
        known="code",
        settings={**_FACETS, "start": "tanh-wide", "limit": "tanh", "beta": 1e-4 * 640**2},
        published={"light": "published", "objective": "complete", "batch": 1},
        adapted={"lr": 0.16},
        stand_ins="weights of the environment feature extractor are trained here and given with --extractor",
    ),
    # RAUCA-final, the paper: the UV map itself, Eq. 4 to 8, under random output augmentation, in better weathers.
    "rauca-final": Method(
        source="Zhou, Lyu, He, Li: Toward Robust and Accurate Adversarial Camouflage Generation, 2025",
        weathers="enhanced",
        known="code",
        settings={"limit": "clamp"},
        published={
            **_NEURAL_RENDERER,
            "sampler": "uv-traversal",
            "light": "published",
            "objective": "complete",
            "augmentation": "published",
            "smooth": "unclamped",
            "map_size": 2048,
            "batch": 1,
        },
        adapted={"lr": 0.04},
        stand_ins="weights of the environment feature extractor are trained here and given with --extractor",
    ),
    # Ours: what this project adds to RAUCA-final to reach detectors and views that took no part.
    "ours": Method(
        source="this project",
        weathers="enhanced",
        settings={
            # Small scores push as hard as large ones: Eq. 6 lets go of a frame long before average precision does.
            "objective": "log-score",
            # Where both sides look alike, every frame is a view of either.
            "natural": Naturalness(symmetric=True),
            "lr": 0.03,
            "decay": 0.03,
            "augmentation": "zoomed",  # docs/results.md, "As near as frames are sharp"
            "rest": 3,  # lower than without, though by no more than chance (docs/ablations.md)
            "turns": True,
            # What every figure of docs/results.md was made with.
            "map_size": 512,
            "samples": 4,
        },
        # By turns seven cost what one does: all of the registry that were trained on photographs, with weights that
        # anybody may use. Fewer leave more to detectors that took no part (docs/results.md, "Longer and broader").
        panel=(
            "yolov3-tiny",
            "yolov4-tiny",
            "yolox-nano",
            "ssd-mobilenet-v2",
            "yolov2-tiny",
            "ssd-mobilenet-v3",
            "mobilenet-ssd",
        ),
        panel_size=320,
    ),
}


# Of ours, where a few hundred steps begin with noise, as in the demo and a hardening: free texels end higher there
# (docs/results.md, "Crops and free texels").
FEW_STEPS: Mapping[str, Any] = MappingProxyType({"natural": Naturalness(feature_cm=5.0, symmetric=True)})


def method_named(name: str) -> Method:
    """The method of that name; raises :class:`RaucaError` listing all when there is none."""
    if name not in METHODS:
        raise RaucaError(f"method: no {name!r}; choose one of {', '.join(METHODS)}")
    return METHODS[name]


def settings_of(name: str, form: Fidelity | None = None, /, **explicit: Any) -> dict[str, Any]:
    """What `make_settings` takes for a method; what is given explicitly wins, the camouflage's name included.

    Args:
        form: ``published`` or ``adapted``; when None, ``fidelity`` of ``explicit``, else adapted.

    Raises:
        RaucaError: no such method; it has no such form.
    """
    method, form = method_named(name), form or explicit.get("fidelity") or "adapted"
    if form not in ("published", "adapted"):
        raise RaucaError(f"--as: no {form!r}; choose published or adapted")
    if form == "published" and not method.known:
        rivals = ", ".join(rival for rival, one in METHODS.items() if one.known)
        raise RaucaError(f"--as published: {name} was never published; drop it, or choose one of {rivals}")
    own = method.published if form == "published" else method.adapted
    called = f"{name}-published" if form == "published" else name
    return {"name": called, **method.settings, **own, **explicit, "method": name, "fidelity": form}


NOT_COMPARED = ("name", "method", "fidelity")


def differences(name: str) -> dict[str, tuple[Any, Any]]:
    """Settings in which a method's published and adapted forms differ, by name; empty where there is one form only."""
    if not method_named(name).known:
        return {}
    published, adapted = (make_settings(**settings_of(name, form)) for form in ("published", "adapted"))
    fields = [field for field in type(published).model_fields if field not in NOT_COMPARED]
    both = {field: (getattr(published, field), getattr(adapted, field)) for field in fields}
    return {field: (one, other) for field, (one, other) in both.items() if one != other}
