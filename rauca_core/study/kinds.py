"""The kinds of artifacts: what each holds, when it is finished, and who makes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from . import makers
from .artifact import Artifact
from .job import Job

Complete = Callable[[Artifact, Path], bool]


@dataclass(frozen=True)
class Kind:
    """A kind of artifact.

    Attributes:
        what: it holds, for people.
        doing: what is said while it is made.
        make: goes on by itself where an earlier process stopped; takes jobs of one ``group``.
        complete: whether a folder holds all that is wanted of an artifact.
        heavy: worth a process, or a machine, of its own.
        group: artifacts of which it says the same are made together.
    """

    what: str
    doing: str
    make: Callable[[Sequence[Job]], None]
    complete: Complete
    heavy: bool = True
    group: Callable[[Artifact], object] = lambda artifact: artifact.digest


def _each(make: Callable[[Job], None]) -> Callable[[Sequence[Job]], None]:
    def make_all(jobs: Sequence[Job]) -> None:
        for job in jobs:
            make(job)

    return make_all


def _light(what: str, doing: str, make: Callable[[Job], None], complete: Complete) -> Kind:
    return Kind(what, doing, _each(make), complete, heavy=False)


def _heavy(what: str, doing: str, make: Callable[[Job], None], complete: Complete) -> Kind:
    return Kind(what, doing, _each(make), complete)


KINDS = {
    "vehicle": _light("vehicles from other formats", "reading the vehicle", makers.make_vehicle, makers.has_vehicle),
    "views": _heavy("data sets", "rendering views", makers.make_views, makers.has_views),
    "part": _light("parts of data sets, linked", "linking frames", makers.make_part, makers.has_plan),
    "extractor": _heavy(
        "published extractors of light", "training the extractor", makers.make_extractor, makers.has_extractor
    ),
    "paint": _heavy("optimized camouflages", "optimizing", makers.make_paint, makers.has_camouflage),
    "random": _light("random camouflages", "drawing random paint", makers.make_random, makers.has_camouflage),
    "renders": Kind(
        "views in camouflage", "re-rendering in camouflage", makers.make_renders, makers.has_renders,
        group=makers.rendered_together,
    ),
    "defended": _heavy("images after a defence", "defending", makers.make_defended, makers.has_renders),
    "detections": Kind(
        "what detectors found", "detecting", makers.make_detections, makers.has_detections,
        group=makers.detected_together,
    ),
    "agreement": _light(
        "neural renders against Cycles", "comparing renderers", makers.make_agreement, makers.has_agreement
    ),
    "hardened": _heavy("hardened detectors", "hardening", makers.make_hardened, makers.has_hardened),
}  # fmt: skip
