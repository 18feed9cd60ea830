"""``hardening.json``: the figures of one hardening, for programs::

    {"format": "rauca-hardening-figures", "version": 1, "detector": "frcnn-synth", "hardened": "hardened-frcnn-synth",
     "clean": {"before": .998, "after": .999, "low": .99, "high": 1.0, "recovered": null}, "held_out": {...},
     "held_out_methods": {...}, "held_out_vehicle": {...}, "held_out_weathers": {...},
     "adaptive_1x": {...}, "adaptive_3x": {...}, "adaptive_10x": {...}, "failed_attacks": [],
     "other_classes_agreement": .99, "other_classes_kept": .99,
     "other_classes": {"agreement": .99, "low": .95, "high": 1.0, "agreed": 90, "objects": 91, "kept": 45, "known": 45,
                       "views": 19, "places": 7},
     "other_objects": {...}, "pictures_without_vehicle": {"agreed": 9, "objects": 9, "kept": 4, "known": 4},
     "other_places": {"seen": {"agreement": .99, ...}, ...},
     "cpu_minutes": 13.1, "rounds": [{"round": 1, "plain": .99, "camouflaged": .9, "cpu_minutes": 4.2}, ...],
     "entries": [{"vehicle": "sedan", "weathers": "seen", "clean": {...}, ..., "other_classes": {...}}]}

Figures are AP@0.5; ``low`` and ``high`` are the 95 % interval of ``after``. Of several vehicles and sets of weathers
the opening figures are those of the entry that ends lowest, but other classes are of all views together; ``entries``
has all, and ``other_places`` what is said of other objects in places where nothing else is judged, by weathers. What
was not measured is null. ``views`` and ``places`` are those that show other objects (`other_classes.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..contract.files import write_json
from ..detect.synth.card import read_any_card
from ..training.harden import WORN
from ..training.measure import ALL
from .hardening import Gain, Gains
from .other_classes import OtherClasses

FILE_NAME = "hardening.json"
FORMAT = ("rauca-hardening-figures", 1)


@dataclass(frozen=True)
class Round:
    """What a round came to: AP@0.5 on frames held out of training, and its CPU minutes."""

    round: int
    plain: float
    camouflaged: float | None
    cpu_minutes: float


@dataclass(frozen=True)
class Cost:
    """CPU minutes of a hardening, attacks and tests included, and of each round.

    What a process that was killed had done of a round before is not counted.
    """

    cpu_minutes: float
    rounds: tuple[Round, ...]


def cost_of(weights: Path, learnt: Path) -> Cost:
    """Of a hardening, from the card beside its weights and those in the folders of its rounds, in ``learnt``."""
    rounds = []
    for number in range(1, 1 + len(list(learnt.glob("round-*/weights.json")))):
        card, _ = read_any_card(learnt / f"round-{number}" / "weights.json")
        ap = card.metrics["ap50"]
        rounds.append(Round(number, ap[ALL], ap.get(WORN), card.cpu_minutes))
    return Cost(read_any_card(weights.with_suffix(".json"))[0].cpu_minutes, tuple(rounds))


@dataclass(frozen=True)
class Figures:
    """All of a hardening.

    Attributes:
        gains: of each entry of the study.
        others: what both detectors say of everything but the vehicle, of each entry.
        unseen_weathers: names of the sets of weathers of which no training data has one.
        other_places: as ``others``, in places in which other objects alone are looked at, by set of weathers.
    """

    before: str
    after: str
    gains: Sequence[Gains]
    others: Sequence[OtherClasses]
    cost: Cost
    unseen_weathers: frozenset[str] = frozenset()
    other_places: Mapping[str, OtherClasses] = field(default_factory=dict)

    @property
    def other_classes(self) -> OtherClasses:
        """Of all views together."""
        return OtherClasses.together([*self.others, *self.other_places.values()])

    @property
    def failed(self) -> list[str]:
        """Adaptive attacks that failed, with vehicle and weathers."""
        return [f"{name}, {one.entry.vehicle}, {one.entry.weathers}" for one in self.gains for name in one.failed]

    def worst(self) -> dict[str, Gain | None]:
        """Each measure where it ends lowest; those of the trained vehicles but for ``held_out_vehicle``."""
        trained = [one for one in self.gains if one.unseen is None]
        found = {
            "clean": lowest(one.clean for one in trained),
            "held_out": lowest(one.held_out for one in trained),
            "held_out_methods": lowest(one.methods for one in trained),
            "held_out_vehicle": lowest(one.unseen for one in self.gains),
            "held_out_weathers": lowest(o.held_out for o in trained if o.entry.weathers in self.unseen_weathers),
        }
        budgets = sorted({1, 3, 10} | {budget for one in trained for budget in one.adaptive})
        return found | {f"adaptive_{k}x": lowest(one.adaptive.get(k) for one in trained) for k in budgets}

    def save(self, out: Path) -> Path:
        """Write ``hardening.json`` into a folder; returns its path."""
        (name, version), path, others = FORMAT, out / FILE_NAME, self.other_classes
        fields = {
            "format": name, "version": version, "detector": self.before, "hardened": self.after,
            **{key: told(gain) for key, gain in self.worst().items()},
            "failed_attacks": self.failed,
            "other_classes_agreement": others.both.share, "other_classes_kept": others.both.kept_share,
            "other_classes": others.told(),
            "pictures_without_vehicle": asdict(others.vacant), "other_objects": asdict(others.beside),
            "other_places": {weathers: one.told() for weathers, one in self.other_places.items()},
            "cpu_minutes": self.cost.cpu_minutes, "rounds": [asdict(one) for one in self.cost.rounds],
            "entries": [_entry(*one) for one in zip(self.gains, self.others, strict=True)],
        }  # fmt: skip
        write_json(path, fields)
        return path


def lowest(gains: Iterable[Gain | None]) -> Gain | None:
    """The one that ends lowest, None if there is none."""
    return min((gain for gain in gains if gain is not None), key=lambda gain: gain.after.ap, default=None)


def told(gain: Gain | None) -> dict[str, float | None] | None:
    """A measure as JSON."""
    if gain is None:
        return None
    after, recovered = gain.after, gain.recovered
    share = None if recovered is None else recovered.ap
    return {"before": gain.before.ap, "after": after.ap, "low": after.low, "high": after.high, "recovered": share}


def _entry(gains: Gains, others: OtherClasses) -> dict[str, Any]:
    measured = {"clean": gains.clean, "held_out": gains.held_out, "held_out_methods": gains.methods}
    measured |= {"held_out_vehicle": gains.unseen} | {f"adaptive_{k}x": gain for k, gain in gains.adaptive.items()}
    where = {"vehicle": gains.entry.vehicle, "weathers": gains.entry.weathers}
    figures = {key: told(gain) for key, gain in measured.items() if gain is not None}
    return where | figures | {"other_classes": others.told()}
