"""How robust a detector is under a battery: what `rauca assess --json` writes, and conditions on it for CI."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.schema import Record, read_json
from .driven import Drives
from .mistakes import Mistakes
from .weak_spots import Cell, Range, WorstTenth


@dataclass(frozen=True)
class Assessed(Record):
    """The detector that was assessed.

    Attributes:
        sha256: of its weights, network, input size and class names; another one each time for a function, which cannot
            be identified.
        differentiable: whether it could be attacked itself.
        why_not: the reason where it could not.
        ms_per_image: median, at the battery's image size, on the machine that assessed it.
    """

    name: str
    family: str
    sha256: str
    differentiable: bool
    why_not: str
    ms_per_image: float


@dataclass(frozen=True)
class Score(Record):
    """How well the vehicles are found in one paint, or over several.

    Attributes:
        ap: AP@0.5 in [0, 1]; ``low`` and ``high`` are its 95 % interval over places.
        recall: share of views in which the vehicle is found at the deployed score.
        frames: how many views that is.
    """

    ap: float
    low: float
    high: float
    recall: float
    frames: int


@dataclass(frozen=True)
class Defended(Record):
    """What a defence in front of the detector gives: the same scores as without it.

    Attributes:
        white_box: in camouflages made against the detector alone, which do not know of the defence.
        informed: in camouflages made against the detector behind this very defence.
    """

    clean: Score
    random: Score
    transfer: Score
    white_box: Score | None
    informed: Score | None

    @property
    def attack_failed(self) -> bool:
        """Whether who knew of the defence got less far than who did not: then the figure says nothing of it."""
        return self.informed is not None and self.white_box is not None and self.informed.ap > self.white_box.ap


@dataclass(frozen=True)
class Assessment(Record):
    """What one battery says of one detector.

    Attributes:
        battery: name of the frozen battery, such as ``assess-4``; ``budget`` is how much of it was used, and
            ``vehicles`` which of its vehicles.
        threshold: the deployed score.
        clean: in the vehicles' own paint.
        random: in random paint.
        transfer: over the library's camouflages that were not made against this detector.
        white_box: in camouflages made against this very detector; None when that was not asked for or is impossible.
        white_box_note: what the attack did not get through, or why there is none.
        transfer_by_camouflage: for each of the library.
        worst_cell, worst_tenth, errors, range_m: by paint.
        defences: by defence.
        seconds: by stage.
        without_place: AP@0.5 of ``clean``, ``random``, ``transfer`` and ``white_box`` without each of the places.
            These are the same for every detector of one battery, so that differences can be told from chance.
        left_out: camouflages of the library that count as no transfer: they were made against this very detector.
        clips: warning lost on the road, over all vehicles; None where no clips were asked for. No other figure is of
            clips.
    """

    FORMAT = ("rauca-assessment", 1)

    detector: Assessed
    battery: str
    budget: str
    vehicles: tuple[str, ...]
    threshold: Annotated[float, (0, 1)]
    clean: Score
    random: Score
    transfer: Score
    white_box: Score | None
    white_box_note: str
    transfer_by_camouflage: dict[str, Score]
    worst_cell: dict[str, Cell]
    worst_tenth: dict[str, WorstTenth]
    errors: dict[str, Mistakes]
    range_m: dict[str, Range]
    defences: dict[str, Defended] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    without_place: dict[str, tuple[float, ...]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    clips: Drives | None = None

    @property
    def worst_camouflage(self) -> str:
        """The one of the library that lowers AP most, of those that were not made against this detector."""
        rivals = {name: one for name, one in self.transfer_by_camouflage.items() if name not in self.left_out}
        return min(rivals, key=lambda name: rivals[name].ap)

    @property
    def headline(self) -> str:
        """The result in one line."""
        parts = [f"{self.detector.name}: AP@0.5 {_shown(self.clean)} plain", f"{_shown(self.random)} in random paint"]
        parts.append(f"{_shown(self.transfer)} in camouflages made for other detectors")
        if self.white_box is not None:
            parts.append(f"{_shown(self.white_box)} in one made for it")
        return ", ".join(parts)


def save_assessment(path: Path, assessment: Assessment) -> None:
    """Write an assessment as JSON, atomically."""
    write_json(path, assessment.to_json())


def load_assessment(path: Path) -> Assessment:
    """Read one; raises :class:`RaucaError` when the file is missing, damaged or of another version."""
    return Assessment.from_json(read_json(path))


def _shown(score: Score) -> str:
    return f"{score.ap:.2f}"


PAINTS, _MEASURES = ("clean", "random", "transfer", "white_box"), ("ap", "low", "recall")
FIGURES = tuple(f"{paint}_{measure}" for paint in PAINTS for measure in _MEASURES)
"""What conditions may be about."""


@dataclass(frozen=True)
class Condition:
    """What continuous integration asks of a detector: a figure that must not be lower than a limit."""

    figure: str
    limit: float

    @staticmethod
    def parse(text: str) -> Condition:
        """Read ``transfer_ap=0.5``.

        Raises:
            RaucaError: no such figure, or no limit between 0 and 1.
        """
        match = re.fullmatch(r"(\w+)=([0-9.]+)", text.strip())
        name, number = match.groups() if match else ("", "")
        try:
            limit = float(number)
        except ValueError:
            limit = -1.0
        if name not in FIGURES or not 0 <= limit <= 1:
            raise RaucaError(
                f"--fail-below {text}: write FIGURE=LIMIT with a limit from 0 to 1, such as transfer_ap=0.5; "
                f"figures are {', '.join(FIGURES)}"
            )
        return Condition(name, limit)

    def failure(self, assessment: Assessment) -> str | None:
        """Why the assessment does not meet the condition; None where it does.

        A figure that was not measured fails: a gate that nobody stands at is open.
        """
        paint, _, measure = self.figure.rpartition("_")
        score: Score | None = getattr(assessment, paint)
        if score is None:
            return f"{self.figure} was not measured: {assessment.white_box_note}"
        found = float(getattr(score, measure))
        return f"{self.figure} is {found:.3f}, below {self.limit:g}" if found < self.limit else None
