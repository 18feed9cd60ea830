"""From detections to the numbers of a table: average precision with its interval, overall and along each parameter."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame
from ..detect import canonical
from .average_precision import Ranking, Sample, average_precision
from .defences import NO_DEFENCE
from .detecting import Pictures
from .detection_cache import DetectionCache
from .intervals import Curve, Places, difference_interval, share_interval
from .results import AXES, Estimate, FrameRow, Group, ImageRow, Results, save_results

Samples = Mapping[str, Mapping[str, Sequence[Sample]]]  # [paint][detector][frame]


def places_of(rows: Sequence[FrameRow]) -> Places:
    """What is left out in turn: the frames' locations, or their views if there is one location."""
    return Places.of([row.location for row in rows], [row.view for row in rows])


def ap_curve(ranking: Ranking, places: Places, ap: float | None = None) -> Curve:
    """AP@0.5 of a ranking of the frames, with all places and without each.

    Args:
        ap: of all, where it is known.
    """
    values = ranking.average_precision(places.left_out(), places.of_frame)
    values[0] = values[0] if ap is None else ap
    return values


def estimate(curve: Curve, frames: int) -> Estimate:
    """A share with its 95 % interval, both over all seeds of the curve."""
    return Estimate(_value(curve), *share_interval(curve, frames))


def difference(curve: Curve, frames: int) -> Estimate:
    """A difference of two shares with its 95 % interval."""
    return Estimate(_value(curve), *difference_interval(curve, frames))


def _value(curve: Curve) -> float:
    return float(np.atleast_2d(curve)[:, 0].mean())


def score_table(samples: Samples, rows: Sequence[FrameRow]) -> dict[str, dict[str, Estimate]]:
    """AP of every paint and detector with its interval."""
    places, table = places_of(rows), {}
    for paint, by_detector in samples.items():
        curves = {n: ap_curve(Ranking.of(some), places, average_precision(some)) for n, some in by_detector.items()}
        table[paint] = {name: estimate(curve, len(rows)) for name, curve in curves.items()}
    return table


def score_groups(samples: Samples, rows: Sequence[FrameRow]) -> dict[str, tuple[Group, ...]]:
    """AP over the frames that share a value, for every axis and value."""
    rankings = {
        paint: {name: Ranking.of(some) for name, some in by_detector.items()} for paint, by_detector in samples.items()
    }

    def group(value: float, chosen: NDArray[np.int64]) -> Group:
        once, together = np.ones((1, 1), np.int64), np.zeros(len(chosen), np.int64)
        ap = {
            paint: {name: float(r.part(chosen).average_precision(once, together)[0]) for name, r in by_detector.items()}
            for paint, by_detector in rankings.items()
        }
        return Group(value, len(chosen), ap)

    values = {axis: np.array([float(getattr(row, axis)) for row in rows]) for axis in AXES}
    return {
        axis: tuple(group(float(value), np.flatnonzero(found == value)) for value in np.unique(found))
        for axis, found in values.items()
    }


def tabulate(
    dataset: Dataset,
    paints: Mapping[str, Pictures],
    caches: Mapping[str, Mapping[str, DetectionCache]],
    out: Path,
    defence: str = NO_DEFENCE,
    dropped: tuple[str, ...] = (),
) -> Results:
    """Compute results from detections and write ``out/results.json``.

    Args:
        paints: the images of each, all of the same frames.
        caches: what was detected in them, by paint and detector.
        defence: that the images went through.
        dropped: ids of frames without a box.
    """
    first = next(iter(caches.values()))
    settings = next(iter(first.values())).settings
    rows = tuple(_frame_row(dataset, frame) for frame in next(iter(paints.values())).frames)
    samples = {
        paint: {name: _samples(cache, rows, pictures.hashes) for name, cache in caches[paint].items()}
        for paint, pictures in paints.items()
    }
    places = places_of(rows)
    results = Results(
        dataset=dataset.plan.name,
        settings=settings,
        detectors={name: cache.fingerprint for name, cache in first.items()},
        frames=rows,
        dropped=dropped,
        table=score_table(samples, rows),
        groups=score_groups(samples, rows),
        images={
            paint: tuple(map(ImageRow, (_relative(path, out) for path in pictures.paths), pictures.hashes))
            for paint, pictures in paints.items()
        },
        detections={
            paint: {name: _relative(cache.path.parent, out) for name, cache in caches[paint].items()}
            for paint in paints
        },
        vehicle=dataset.plan.vehicle_name,
        defence=defence,
        place_kind=places.kind,
        place_count=places.count,
        composed=dataset.require_rendered_or_pictured("detectors are judged on"),
    )
    save_results(out / "results.json", results)
    return results


def _samples(cache: DetectionCache, rows: Sequence[FrameRow], hashes: Sequence[str]) -> list[Sample]:
    target = canonical(cache.settings.category)
    found = [cache[image].only(target) for image in hashes]
    return [
        Sample(np.array(row.box_xyxy, np.float64), one.boxes, one.scores) for row, one in zip(rows, found, strict=True)
    ]


def _frame_row(dataset: Dataset, frame: Frame) -> FrameRow:
    weather, plan = frame.weather, dataset.plan
    if frame.pictured:  # whose photographer knew no plan
        camera = (float(round(frame.azimuth_deg % 360)), float(round(frame.elevation_deg)), round(frame.distance_m, 1))
    elif plan.clips is None:
        camera = plan.ring.nominal(frame.view)
    else:  # no two frames of a drive share an angle: those near each other are counted together
        steps = (frame.azimuth_deg / 45, frame.elevation_deg / 8, frame.distance_m / 4)
        camera = (round(steps[0]) % 8 * 45.0, round(steps[1]) * 8.0, round(steps[2]) * 4.0)
    assert frame.box_xyxy is not None
    shown = (weather.sun_altitude_angle, weather.fog_density, frame.box_xyxy)
    return FrameRow(frame.id, weather.name, *camera, *shown, frame.location, frame.view)


def _relative(path: Path, out: Path) -> str:
    return Path(os.path.relpath(path, out)).as_posix()
