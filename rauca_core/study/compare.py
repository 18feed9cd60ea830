"""Camouflages of finished studies held against each other: seeds are one row, and judges stand by their part in it.

Paints called ``NAME s0``, ``NAME s1`` ... are optimizations of one row that differ by their seed: its AP is their mean,
and its interval is over places and seeds. What was attacked, what is of an attacked detector's family and what took no
part are never averaged together, and the judges of a table took part in none of its rows.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

from scipy import stats

from ..contract import Dataset, RaucaError
from ..contract.files import file_digest
from ..contract.towns import TEST, TRAINING, VALIDATION
from .ablations.experiment import OURS, Claim
from .ablations.findings import Scores, Verdict, judge, score_rows
from .candidates import NORMAL, RANDOM
from .defences import NO_DEFENCE
from .parts import PARTS, RELATIVE, TOOK_NO_PART, attacked_by, parts_of
from .results import Estimate
from .scores import places_of
from .study import Entry, Study

_SEED = re.compile(r"(?P<row>.+) s\d+")


def rows_of(paints: Sequence[str]) -> dict[str, list[str]]:
    """Row -> its paints, one per seed.

    >>> rows_of(["normal", "ours s0", "ours s1", "theirs"])
    {'normal': ['normal'], 'ours': ['ours s0', 'ours s1'], 'theirs': ['theirs']}
    """
    rows: dict[str, list[str]] = {}
    for paint in paints:
        matched = _SEED.fullmatch(paint)
        rows.setdefault(matched["row"] if matched else paint, []).append(paint)
    return rows


@dataclass(frozen=True)
class Compared:
    """Rows in the same places, before the same detectors.

    Attributes:
        entries: of all studies, each under a name of its own as ``weathers``.
        rows: row -> its paints, one per seed.
        attacked: row -> the detectors that it was optimized against.
        town: the seed of the places.
    """

    entries: tuple[Entry, ...]
    rows: Mapping[str, Sequence[str]]
    attacked: Mapping[str, frozenset[str]]
    town: int

    @property
    def use(self) -> str:
        """What the town is for, as `contract.towns` lists it, or ``unlisted``."""
        uses = {"training": TRAINING, "validation": VALIDATION, "test": TEST}
        return next((use for use, towns in uses.items() if self.town in towns.values()), "unlisted")

    @property
    def places(self) -> str:
        """What intervals are over: ``"24 locations"``."""
        every = places_of([row for entry in self.entries for row in entry.results.frames])
        return f"{every.count} {every.kind}"

    @cached_property
    def scores(self) -> Scores:
        """AP of every row and detector under every entry, with all places and without each."""
        given = frozenset(row for row in self.rows if not self.attacked[row])
        return replace(score_rows(self.entries, self.rows), given=given)

    @property
    def against(self) -> frozenset[str]:
        """All that was attacked, by any row."""
        return frozenset(chain(*self.attacked.values()))

    @cached_property
    def _parts(self) -> dict[str, list[str]]:
        return parts_of(self.scores.detectors, self.against)

    @property
    def judges(self) -> list[str]:
        """Detectors that took no part."""
        return self._parts.get(TOOK_NO_PART, [])

    @property
    def relatives(self) -> list[str]:
        """Detectors of an attacked one's family that no row attacked itself."""
        return self._parts.get(RELATIVE, [])

    def white_box(self, row: str) -> list[str]:
        """Measured detectors that a row attacked; of a row that attacked none, those that any did."""
        return attacked_by(self._parts, self.attacked[row])

    def by_part(self, row: str) -> dict[str, Estimate | None]:
        """A row's mean over all views, by the detectors' part in the attacks; None where there is no such detector."""
        groups = zip(PARTS, (self.judges, self.relatives, self.white_box(row)), strict=True)
        return {part: self.ap(row, names) if names else None for part, names in groups}

    def ap(self, row: str, detectors: Sequence[str], weathers: Sequence[str] = ()) -> Estimate:
        """Mean AP over detectors, entries (all of them if none is named) and seeds."""
        return self.scores.ap(row, detectors, weathers or self.scores.weathers)

    def verdicts(self, better: str) -> list[Verdict]:
        """Whether a row's mean over the judges is below every other's, corrected for how many there are.

        Raises:
            RaucaError: no such row, or no detector that took no part.
        """
        if better not in self.rows:
            raise RaucaError(f"--lowest {better}: no such row; choose one of {', '.join(self.rows)}")
        if not self.judges:
            raise RaucaError("compare: every detector took part in an attack; evaluate with others, too")
        claims = [Claim((better,), (row,), OURS) for row in self.rows if row != better]
        return judge(claims, self.scores, self.judges, self.white_box(better))

    def rank_correlation(self, published: Mapping[str, float]) -> tuple[float, int] | None:
        """Spearman's correlation of rows' mean AP over the judges with published ones, and over how many rows.

        Args:
            published: mean AP by row; random paint is left out, as everybody draws another one.

        Returns:
            None with fewer than three rows in common, or without judges.
        """
        common = [row for row in self.rows if row in published and row != RANDOM]
        if len(common) < 3 or not self.judges:
            return None
        here = [self.ap(row, self.judges).ap for row in common]
        found = stats.spearmanr(here, [published[row] for row in common]).statistic
        return float(found), len(common)


def compare(studies: Mapping[str, Study], only: Sequence[str] = ()) -> Compared:
    """Hold the undefended entries of finished studies against each other.

    Args:
        studies: by name, at least one, such as one per ring of cameras.
        only: rows that take part; all if none is named. What others attacked then says nothing of a judge.

    Raises:
        RaucaError: several vehicles, towns, or sets of detectors; pictures beside rendered views; different
            camouflages under one name; rows of different numbers of seeds; results that do not say where they stand;
            no such row.
    """
    entries = [
        replace(entry, weathers=entry.weathers if len(studies) == 1 else f"{name}, {entry.weathers}")
        for name, study in studies.items()
        for entry in study.of(defence=NO_DEFENCE)
    ]
    if not entries:
        raise RaucaError("compare: nothing was evaluated without a defence; evaluate with --defences none")
    if len({entry.folder.resolve() for entry in entries}) < len(entries):
        raise RaucaError("compare: a study was given twice; its frames would count twice")
    rows = _chosen(entries, only)
    first, shown = entries[0], set(chain(*rows.values()))
    for entry in entries[1:]:
        where = f"{entry.folder / 'results.json'}"
        if (entry.vehicle, entry.category) != (first.vehicle, first.category):
            raise RaucaError(
                f"{where}: of the {entry.vehicle}, {first.folder} of the {first.vehicle}; compare each apart"
            )
        if entry.results.composed != first.results.composed:
            raise RaucaError(
                f"{where}: of composed pictures or of rendered views, {first.folder} not; compare each apart"
            )
        if entry.results.detectors != first.results.detectors:
            raise RaucaError(f"{where}: judged by other detectors than {first.folder}; evaluate all with the same")
        if _maps(entry, shown) != _maps(first, shown):
            raise RaucaError(
                f"{where}: of other camouflages than {first.folder}; evaluate the same under the same names, or name "
                "the rows that both have with --rows"
            )
    towns = {_town(entry) for entry in entries}
    if len(towns) > 1:
        raise RaucaError(
            f"compare: studies in different towns ({', '.join(map(str, sorted(towns)))}); compare each apart"
        )
    attacked = {
        row: frozenset(chain(*(first.against.get(paint, ()) for paint in paints))) for row, paints in rows.items()
    }
    return Compared(tuple(entries), rows, attacked, towns.pop())


def _chosen(entries: Sequence[Entry], only: Sequence[str]) -> dict[str, list[str]]:
    """Rows that take part, with their paints; raises :class:`RaucaError` as :func:`compare`."""
    rows = rows_of(list(dict.fromkeys(chain(*(entry.results.paints for entry in entries)))))
    if strange := [name for name in only if name not in rows]:
        raise RaucaError(f"--rows {strange[0]}: no such row; choose of {', '.join(rows)}")
    rows = {row: paints for row, paints in rows.items() if row in (only or rows)}
    counts = {len(paints) for row, paints in rows.items() if row not in (NORMAL, RANDOM)} - {1}
    if len(counts) > 1:
        told = ", ".join(f"{row} {len(paints)}" for row, paints in rows.items())
        raise RaucaError(f"compare: rows of different numbers of seeds ({told}); evaluate as many of each, or one")
    return rows


def _maps(entry: Entry, shown: Collection[str]) -> dict[str, str]:
    """Paint -> the digest of its UV map, of those that are shown."""
    return {p: file_digest(path.with_suffix(".png")) for p, path in entry.camouflages.items() if p in shown}


def _town(entry: Entry) -> int:
    if entry.views is None:
        raise RaucaError(f"{entry.folder / 'results.json'}: does not say which views it is of; evaluate again")
    return Dataset(entry.views).plan.seed
