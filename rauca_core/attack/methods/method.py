"""A method of the literature, stated as settings of the optimizer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Method:
    """What is painted, what is made small, how frames are lit and augmented, and what keeps the paint smooth.

    Attributes:
        name: as on the command line and in ``camouflage.json``.
        source: authors, title, venue and year.
        weathers: the data set that its authors would use: ``single``, ``base`` or ``enhanced``.
        settings: of `OptimizerSettings`, where they differ from its defaults.
        assumed: what its paper leaves open, or this framework does otherwise; one sentence each.
    """

    name: str
    source: str
    weathers: str
    settings: Mapping[str, Any]
    assumed: tuple[str, ...]
