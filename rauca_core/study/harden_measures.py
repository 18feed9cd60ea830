"""What a hardened detector is measured by beside camouflages that were given: attacks that know it, and attacks of a
kind, or on a vehicle, that it never met.

Every one is an artifact, so that a killed run goes on with the step at which it stopped, and the next one finds them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..contract import Dataset, RaucaError, load_camouflage, read_plan
from ..training.settings import HardenSettings
from . import recipes
from .artifact import Artifact
from .candidates import Candidate, VehicleChoice, read_vehicle_choice
from .detectors import Chosen
from .engine import Engine
from .harden_rounds import attack_settings
from .makers import CAMOUFLAGE
from .ranking import best_of
from .store import link

ADAPTIVE, METHOD, UNSEEN = "adaptive-", "method-", "unseen-vehicle"


@dataclass(frozen=True)
class Measures:
    """What is measured.

    Attributes:
        budgets: of the adaptive attacks, in multiples of all steps of the hardening's own attacks.
        restarts: of each of them; of several the last one begins with the held-out camouflage that still works best
            and leaves its texels free, the others begin with noise in patches. The strongest on training views is worn.
        methods: of the literature, see ``attack.METHODS``, which the hardening never attacks by: a camouflage of each
            is made against the detector as it was.
        vehicles: data sets with light maps of vehicles that the hardening never shows.
        other_places: how many more places are looked at for other objects alone, a view of each in each set of
            weathers, with a vehicle in its own paint; none where views are given.
    """

    budgets: tuple[int, ...] = (1, 3, 10)
    restarts: int = 2
    methods: tuple[str, ...] = ()
    vehicles: tuple[Path, ...] = ()
    other_places: int = 48

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the paints that are made, in the order of tables."""
        made = (*(METHOD + one for one in self.methods), *map(adaptive_label, self.budgets))
        return (*made, UNSEEN) if self.vehicles else made

    def check(self, settings: HardenSettings, known: Iterable[Path], data: Sequence[Path]) -> list[VehicleChoice]:
        """Find mistakes before any work; returns the held-out vehicles.

        Args:
            known: camouflages that are trained on.
            data: that is trained on.

        Raises:
            RaucaError: budgets of no attack, a method or a vehicle that is trained on.
        """
        if list(self.budgets) != sorted(set(self.budgets)) or (self.budgets and self.budgets[0] < 1):
            raise RaucaError(
                f"--budgets {','.join(map(str, self.budgets))}: give whole numbers from 1 on, smallest first"
            )
        if (self.budgets or self.methods or self.vehicles) and not settings.attack_budget:
            raise RaucaError("--attack-steps 0: budgets are multiples of it; add --budgets none, or give some steps")
        trained = {*(settings.attack_methods if settings.attack_steps else ())}
        trained |= {load_camouflage(path)[0].method for path in known}
        for method in self.methods:
            if method in trained:
                raise RaucaError(f"--held-out-method {method}: the hardening is trained on it; choose another one")
            attack_settings(settings, method, 1, method, Path(), method)
        atlases, chosen = {read_plan(folder).atlas_id for folder in data}, []
        for folder in self.vehicles:
            vehicle = read_vehicle_choice(Dataset(folder).vehicle_folder)
            if vehicle.atlas_id in atlases:
                raise RaucaError(f"{folder}: shows {vehicle.name}, which --data shows too; hold another vehicle out")
            chosen.append(vehicle)
        return chosen


def adaptive_label(budget: int) -> str:
    return f"{ADAPTIVE}{budget}x"


def held_out_paints(
    engine: Engine, out: Path, vehicle: VehicleChoice, data: Path, settings: HardenSettings, labels: Mapping[str, str],
    before: Chosen,
) -> dict[str, Path]:  # fmt: skip
    """Camouflages (JSON) against the detector as it was, each at the budget of the hardening's own attacks.

    Args:
        data: with light maps, of the vehicle.
        labels: of the paints, with the method of each.
    """
    wanted = {
        label: recipes.paint(
            recipes.views_in(data),
            attack_settings(settings, label, settings.attack_budget, label, engine.store.folder / "taps", method),
            [before],
        )
        for label, method in labels.items()
    }
    made = engine.make_named(wanted)
    for label, folder in made.items():
        link(out / "attacks" / vehicle.name / label, folder)
    return {label: folder / CAMOUFLAGE for label, folder in made.items()}


def adaptive_paints(
    engine: Engine,
    out: Path,
    vehicle: VehicleChoice,
    data: Path,
    settings: HardenSettings,
    measures: Measures,
    held_out: Sequence[Candidate],
    after: Chosen,
) -> dict[str, Path]:
    """Camouflages (JSON) against the hardened detector, the strongest that each budget reaches.

    A larger budget goes on from where each restart of the smaller one ended, and may fall back on what that one found,
    so that more steps never count as a weaker attack.

    Args:
        data: with light maps, of the vehicle.
    """
    views, taps = recipes.views_in(data), engine.store.folder / "taps"
    ends: list[Path | None] = [None] * measures.restarts
    if measures.restarts > 1:
        ends[-1] = _best(engine, views, [one.path for one in held_out], vehicle, after)
    free = [end is not None for end in ends]  # patches would blur what was given
    reached: list[Path] = []
    paints: dict[str, Path] = {}
    for budget, done in zip(measures.budgets, (0, *measures.budgets), strict=False):
        label, steps = adaptive_label(budget), (budget - done) * settings.attack_budget
        asked = [
            attack_settings(settings, label, steps, f"{label}.{number}", taps, begin_with=begun, free=free[number])
            for number, begun in enumerate(ends)
        ]
        ends = [folder / CAMOUFLAGE for folder in engine.make(*(recipes.paint(views, one, [after]) for one in asked))]
        reached += [end for end in ends if end is not None]
        best = _best(engine, views, reached, vehicle, after)
        assert best is not None
        link(out / "attacks" / vehicle.name / label, best.parent)
        paints[label] = best
    return paints


def _best(
    engine: Engine, views: Artifact, paints: Sequence[Path], vehicle: VehicleChoice, judge: Chosen
) -> Path | None:
    """The camouflage that hides best on training views; of composed ones, by the score that the attack ended with."""
    if len(paints) < 2:
        return paints[0] if paints else None
    assert views.place is not None
    if any(frame.composed for frame in Dataset(views.place).frames()):
        return min(paints, key=lambda path: float(load_camouflage(path)[0].made["final_losses"]["score"]))
    maps = [recipes.camouflage_in(path, f"{number}") for number, path in enumerate(paints)]
    (ranked,) = engine.make(recipes.ranking(views, maps, judge[1], judge[0], vehicle.target))
    return best_of(ranked, paints)
