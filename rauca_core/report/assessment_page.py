"""An assessment as one HTML file for an engineer with ten minutes, and its numbers beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..study.assess import CLIPS, FILE_NAME, WHITE_BOX
from ..study.assessment import Assessment, Score
from ..study.assessment_change import Change, changes
from ..study.candidates import NORMAL, RANDOM
from ..study.defences import NO_DEFENCE
from ..study.pooled import Pool
from ..study.recall import Around, Recall, along_distance, around
from ..study.study import Study
from .assessment_tables import (
    PAINTS,
    around_table,
    changes_table,
    count_of,
    defences_table,
    distance_table,
    errors_table,
    paints_of,
    paints_table,
    shown_range,
    weak_spots_table,
    where,
)
from .clips_page import clip_tables
from .figures import around_svg, intervals_svg, paint_styles
from .frames import reading_of
from .page import write_study_page
from .table import Source
from .worst_views import ViewPicker


def write_assessment(
    found: Assessment, study: Study, out: Path, before: Assessment | None = None, latex: bool = True
) -> list[Path]:
    """Write the page to ``out`` (.html), and its numbers (.csv, .json, .tex) beside it; returns all, the page first.

    Args:
        found, study: as :func:`rauca_core.study.assess.assess` returns them.
        before: an earlier assessment under the same battery, to say what changed.
        latex: whether to write the .tex.

    Raises:
        RaucaError: images or detections that are missing or have changed, ``before`` is of another battery, budget or
            vehicles; then nothing was written.
    """
    changed = changes(before, found) if before is not None else ()
    seen = _Seen(found, study)
    curve = distance_table(seen.along())
    sides = [(paint, around_svg(views), around_table(paint, views)) for paint, views in seen.sides().items()]
    main, styles = paints_table(found), paint_styles(paints_of(found))
    driven = [] if found.clips is None else clip_tables(found.clips, Source(FILE_NAME, ("clips", "rows")))
    numbers = {"errors": errors_table(found), "weak": weak_spots_table(found), "defences": defences_table(found)}
    compared = changes_table(changed) if changed else None
    told = {
        "title": f"How robust is {found.detector.name}?",
        "scope": _scope(found, seen),
        "headline": f"{found.headline}.",
        "lead": [*_lead(found), *_changed(changed)],
        "styles": styles,
        "found": found,
        "main": main,
        "intervals": intervals_svg(main, styles),
        "changes": compared,
        "curve": curve,
        "around": sides,
        "missed": seen.picker.missed_plain(),
        "lost": [seen.picker.lost_in(paint) for paint in seen.paints if paint not in (NORMAL, RANDOM)],
        "reading": reading_of(seen.entries[0].category, found.threshold),
        "driven": driven,
        "driven_page": f"{CLIPS}/clips.html" if (out.parent / CLIPS / "clips.html").is_file() else "",
        "assessed": _assessed(found),
        **numbers,
    }
    tables = [main, *filter(None, (compared, *numbers.values())), *driven, curve, *(table for _, _, table in sides)]
    about = {"detector": found.detector.to_json(), "battery": found.battery, "budget": found.budget}
    return write_study_page(
        study, out, "assessment.html", told, tables, about, {}, timings_s=found.seconds, limits=_limits(found, seen),
        latex=latex, fewest=len(seen.pool.rows),
    )  # fmt: skip


class _Seen:
    """What the detector found in the views, without a defence."""

    def __init__(self, found: Assessment, study: Study) -> None:
        self.found, self.entries = found, study.of(defence=NO_DEFENCE)
        # Views of one name stand in one town, whichever vehicle they show.
        towns = {entry.weathers: number for number, entry in enumerate(self.entries)}
        self.pool = Pool(self.entries, found.detector.name, lambda entry: towns[entry.weathers])
        self.picker = ViewPicker(self.entries, self.pool, found.detector.name, found.threshold)

    @property
    def paints(self) -> list[str]:
        """What pictures and plots show: the vehicle's own paint, random, the library's worst, the detector's own."""
        shown = (NORMAL, RANDOM, self.found.worst_camouflage, WHITE_BOX)
        return [paint for paint in shown if paint in self.found.errors]

    def along(self) -> dict[str, dict[float, Recall]]:
        """Recall by distance of each paint shown."""
        hits = {paint: (self.pool.scores(paint) >= self.found.threshold).astype(np.float64) for paint in self.paints}
        return {paint: along_distance(self.pool.rows, found, self.pool.places) for paint, found in hits.items()}

    def sides(self) -> dict[str, Around]:
        """The same views by side and distance."""
        return {paint: around(self.pool.rows, self.pool.scores(paint) >= self.found.threshold) for paint in self.paints}


def _scope(found: Assessment, seen: _Seen) -> str:
    weathers = len({row.weather for row in seen.pool.rows})
    views, places = len(seen.pool.rows), seen.pool.places.count
    return (
        f"Family {found.detector.family}. Battery {found.battery}, budget {found.budget}: {views} views of "
        f"{' and '.join(found.vehicles)} in {places} places and {weathers} weathers, each rendered in "
        f"{len(seen.pool.paints)} paints."
    )


def _lead(found: Assessment) -> list[str]:
    """What the headline means."""
    worst, clean = found.worst_camouflage, found.clean
    cell = found.worst_cell[NORMAL]
    reach = {paint: shown_range(found.range_m[paint]) for paint in (NORMAL, worst, WHITE_BOX) if paint in found.range_m}
    ranges = ", ".join(f"{metres} in {paint}" for paint, metres in reach.items())
    return [
        f"At its deployed score of {found.threshold:g} it finds {clean.recall:.0%} of the vehicles in their own paint, "
        f"“{NORMAL}” below (AP@0.5 {clean.ap:.2f}, 95 % interval {clean.low:.2f} to {clean.high:.2f}), "
        f"{found.random.recall:.0%} in random paint ({_shown(found.random)}) and {found.transfer.recall:.0%} in "
        f"camouflages made for other detectors ({_shown(found.transfer)}); of these the worst is {worst} "
        f"({_shown(found.transfer_by_camouflage[worst])}).",
        _attacked(found),
        f"In their own paint vehicles are hardest to find from this side, at this distance and in this weather: "
        f"{where(cell.azimuth_deg, cell.distance_m, cell.weather)} (found in {count_of(cell.recall, len(cell.frames))} "
        f"views). They are found more often than missed up to: {ranges}.",
    ]


def _attacked(found: Assessment) -> str:
    if found.white_box is None:
        return f"Not attacked itself: {found.white_box_note}."
    return (
        f"In camouflages made against this very detector it finds {found.white_box.recall:.0%} "
        f"({_shown(found.white_box)}): {found.white_box_note}."
    )


def _shown(score: Score) -> str:
    return f"{score.ap:.2f}, {score.low:.2f} to {score.high:.2f}"


def _changed(found: Sequence[Change]) -> list[str]:
    """What changed beyond chance since an earlier assessment."""
    if not found:
        return []
    told = [
        f"{PAINTS[one.paint]} {one.difference:+.3f} ({one.low:+.3f} to {one.high:+.3f})"
        for one in found
        if one.beyond_chance
    ]
    chance = [PAINTS[one.paint] for one in found if one.decided and not one.beyond_chance]
    luck = [f"{PAINTS[one.paint]} {one.difference:+.3f}" for one in found if not one.decided]
    parts = [f"changed beyond chance: {', '.join(told)}"] if told else []
    parts += [f"not to be told from chance: {', '.join(chance)}"] if chance else []
    parts += [f"undecided, as each was attacked by itself: {', '.join(luck)}"] if luck else []
    return [f"Since the earlier assessment, AP@0.5 {'; '.join(parts)}."]


def _assessed(found: Assessment) -> Mapping[str, Any]:
    one = found.detector
    return {
        "detector": one.name,
        "family": one.family,
        "sha256": one.sha256 or "none: a function cannot be identified",
        "speed": f"{one.ms_per_image:.3g} ms an image on the machine that assessed it",
        "attacked itself": "possible, it has gradients" if one.differentiable else f"not possible: {one.why_not}",
        "deployed score": f"{found.threshold:g}",
    }


def _limits(found: Assessment, seen: _Seen) -> list[str]:
    frames, places = len(seen.pool.rows), seen.pool.places.count
    told = [
        f"All is said of the battery {found.battery} with the budget {found.budget}: {frames} views in {places} places "
        "of synthetic towns. Other streets, vehicles and seasons are not in it.",
        "An attack is a search that stopped: longer ones, of other kinds, or with more knowledge may find worse. What "
        "stands here is an upper bound of the robustness, never a guarantee.",
        "No camouflage here had to survive printing, dirt or wear; on a real vehicle it may do less.",
    ]
    if found.left_out:
        told.append(
            f"Made against this very detector, and so left out of transfer: {', '.join(found.left_out)}. The mean is "
            "over the other camouflages; compare detectors with care, each has a mean of its own."
        )
    if found.white_box is None:
        told.append("Nothing here says what a camouflage made against this very detector would do.")
    return told
