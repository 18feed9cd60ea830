"""What an ablation is: variants of one optimization, the orderings that somebody claims for them, and its size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ...contract import RaucaError
from ...contract.towns import VALIDATION
from ..views import RING, HeldOut

PAPER, OURS = "the paper", "this project"


@dataclass(frozen=True)
class Variant:
    """One row of the table: a camouflage, optimized once for every seed.

    Attributes:
        key: in files and folders; letters, digits, dots and dashes.
        title: in tables.
        settings: of `OptimizerSettings`, where they differ from the common ones or from those of ``method``.
        method: of the literature, whose settings it starts from; None for this project's own.
        training: name of the data set that it is optimized on, see `ablate.TRAINING_SETS`.
        share: of that data set's frames.
        paper_row: its row in the paper's table; None where the paper has none.
        quick: take part in the quick size, too.
    """

    key: str
    title: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    method: str | None = None
    training: str = "enhanced"
    share: float = 1.0
    paper_row: str | None = None
    quick: bool = True


@dataclass(frozen=True)
class Claim:
    """Every variant of ``better`` is detected less than every one of ``worse`` (keys of variants, or ``normal`` or
    ``random``).

    Attributes:
        by: who says so.
    """

    better: tuple[str, ...]
    worse: tuple[str, ...]
    by: str = PAPER


@dataclass(frozen=True)
class Experiment:
    """An ablation.

    Attributes:
        name: on the command line.
        title, question: for people.
        paper: ``beside`` of the paper's table in `assets/paper/tables.json`; empty if it has none.
        seeds: camouflages of each variant that fit the default size's two hours.
        notes: what differs from the paper's experiment, a sentence each.
    """

    name: str
    title: str
    question: str
    variants: tuple[Variant, ...]
    claims: tuple[Claim, ...]
    paper: str = ""
    seeds: int = 1
    notes: tuple[str, ...] = ()

    def variant(self, key: str) -> Variant:
        """The variant of that key; raises :class:`RaucaError` naming all when there is none."""
        for variant in self.variants:
            if variant.key == key:
                return variant
        raise RaucaError(f"{self.name}: no variant {key!r}; choose of {', '.join(v.key for v in self.variants)}")


@dataclass(frozen=True)
class Sizes:
    """The extent of an ablation.

    Attributes:
        frames: of every training set; those that hide most of the paint are left out of them.
        held_out: frames to measure on, per weather set.
        weathers: sets of held-out views, ``seen`` and ``unseen``.
        steps, batch, lr, map_size: of every optimization, where a variant says nothing else.
        pixels, samples: of all frames: their side, and Cycles samples per pixel.
        detectors: to measure with; None for every one that is ready and was not trained on this project's images.
        seeds: camouflages per variant; None for the experiment's own choice.
        extractor_epochs: of the published extractor's training, where it takes part.
    """

    frames: int = 96
    held_out: int = 64
    weathers: tuple[str, ...] = ("seen", "unseen")
    steps: int = 600
    batch: int = 4
    lr: float = 0.02
    map_size: int = 1024
    pixels: int = 320
    samples: int = 8
    detectors: tuple[str, ...] | None = None
    seeds: int | None = None
    extractor_epochs: int = 20

    @property
    def views(self) -> HeldOut:
        """The held-out views, in a validation town: what an ablation shows is chosen, and judged elsewhere."""
        return HeldOut(self.held_out, RING, size=self.pixels, samples=self.samples, seed=VALIDATION["ablations"])


QUICK = Sizes(
    frames=16,
    held_out=12,
    weathers=("seen",),
    steps=60,
    map_size=512,
    pixels=192,
    samples=4,
    detectors=("yolov3-tiny", "yolov4-tiny"),
    seeds=1,
    extractor_epochs=2,
)
