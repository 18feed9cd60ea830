"""What an ablation is: variants of one optimization, and the orderings that somebody claims for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ...contract import RaucaError

PAPER, OURS = "the paper", "this project"


@dataclass(frozen=True)
class Variant:
    """One row of the table: a camouflage, optimized once for every seed.

    Attributes:
        key: in files and folders; letters, digits, dots and dashes.
        title: in tables.
        settings: of `OptimizerSettings`, where they differ from the common ones or from those of ``method``.
        method: of the literature, whose settings it starts from; None for this project's own.
        training: name of the data set that it is optimized on, see `training_sets`.
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

    def __post_init__(self) -> None:
        keys = [variant.key for variant in self.variants]
        named = {key for claim in self.claims for key in (*claim.better, *claim.worse)}
        if len(set(keys)) < len(keys) or named - {*keys, "normal", "random"}:
            raise ValueError(f"{self.name}: variants {keys} do not fit the claims about {sorted(named)}")

    def variant(self, key: str) -> Variant:
        """The variant of that key; raises :class:`RaucaError` naming all when there is none."""
        for variant in self.variants:
            if variant.key == key:
                return variant
        raise RaucaError(f"{self.name}: no variant {key!r}; choose of {', '.join(v.key for v in self.variants)}")
