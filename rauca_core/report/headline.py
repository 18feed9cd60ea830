"""What a study found, in a few sentences that its tables bear out."""

from __future__ import annotations

from ..study.defended import NO_DEFENCE
from ..study.results import MEAN, Results
from ..study.study import Entry, Study
from .frame_choice import strongest_paint
from .tables import is_normal, is_random, shown
from .tables.of_study import defence_title, unique, vehicles_of, weathers_title


def scope(study: Study) -> str:
    """How much was measured."""
    results = [entry.results for entry in study.entries]
    detectors = unique(name for found in results for name in found.detectors)
    paints = unique(paint for found in results for paint in found.paints)
    conditions = unique(weathers_title(entry.weathers).removesuffix(" weathers").lower() for entry in study.entries)
    defences = [defence_title(d) for d in unique(entry.defence for entry in study.entries) if d != NO_DEFENCE]
    parts = [
        _count(len(paints), "paint"),
        _count(len(detectors), "detector"),
        _count(len(vehicles_of(study)), "vehicle"),
        " and ".join(conditions) + (" weathers" if {"seen", "unseen"} >= set(conditions) else ""),
        *([f"defences: {', '.join(defences)}"] if defences else []),
    ]
    images = sum(len(found.frames) * len(found.paints) for found in results)
    return f"{', '.join(parts)}; {images:,} images evaluated."


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def headline(study: Study) -> list[str]:
    """A sentence per set of weathers: how far the most effective paint lowers AP, undefended."""
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    return [_sentence(entry) for entry in entries if any(map(is_normal, entry.results.paints))]


def _sentence(entry: Entry) -> str:
    results = entry.results
    where = f"{weathers_title(entry.weathers).capitalize()}: "
    normal = next(paint for paint in results.paints if is_normal(paint))
    best = strongest_paint(results)
    if best == normal:
        return f"{where}{entry.category} AP@0.5, mean over detectors: {_mean(results, normal)} for {normal}."
    before, after = results.table[normal][MEAN], results.table[best][MEAN]
    verb = "lowers" if after.ap < before.ap else "does not lower"
    values = [f"{_mean(results, paint)} for {paint}" for paint in (normal, *_randoms(results, best), best)]
    cautions = [
        f", no lower than {paint}" for paint in _randoms(results, best) if after.ap >= results.table[paint][MEAN].ap
    ]
    if after.high >= before.low and before.high >= after.low:
        cautions.append(f"; the intervals of {normal} and {best} overlap")
    mean = f"(mean over {_count(len(results.detectors), 'detector')})"
    return f"{where}{best} {verb} {entry.category} AP@0.5 {mean}: {', '.join(values)}{''.join(cautions)}."


def _randoms(results: Results, best: str) -> list[str]:
    """Random paint alone lowers AP too: no result should be read without it."""
    return [paint for paint in results.paints if is_random(paint) and paint != best]


def _mean(results: Results, paint: str) -> str:
    return shown(results.table[paint][MEAN].ap)
