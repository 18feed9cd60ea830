"""The order of events of ``rauca bench defences``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from benchmarks.page import fill_page
from benchmarks.tables import markdown_tables, print_tables
from pipelines.console import progress_bar
from rauca_core.contract import Progress, RaucaError
from rauca_core.contract.files import write_json
from rauca_core.detect import Detector, car_score, class_index, load_detector
from rauca_core.study.average_precision import Sample, average_precision
from rauca_core.study.defences import Defence, defence_names, make_defence

from .patch import optimize_patch, paste
from .results import Outcome, Results, grids
from .sheet import save_sheet
from .views import Views, read_views

ALTERED = 16 / 255
BATCH = 6
LOW_SCORE, NMS_IOU = 0.005, 0.45  # as `rauca evaluate` has them


@dataclass(frozen=True)
class Extent:
    """How much to measure: steps of the patch's optimization, views at most, share of the box under the patch."""

    steps: int
    views: int
    patch: float = 0.25


FULL, QUICK = Extent(steps=120, views=10**6), Extent(steps=20, views=8)


def bench_defences(
    run: Path, detectors: Sequence[str], out: Path, quick: bool = False, docs: Path | None = None, patch: float = 0.25
) -> Results:
    """Every defence on a run's held-out views: normal, in camouflage, and normal with an optimized patch.

    The patch is optimized on every other view against the first detector, and measured on the rest.

    Args:
        run: folder laid out as the demo's.
        detectors: names from ``rauca weights list``.
        out: JSON to write; the sheet of pictures goes beside it.
        patch: share of the vehicle's box that it covers.
        docs: folder whose ``defences.md`` gets the figures anew, and its pictures the sheet.

    Raises:
        RaucaError: the run has no views, the patch is larger than the box, a detector's weights are missing.
    """
    if not 0 < patch <= 1:
        raise RaucaError(
            f"--patch {patch}: the share of the vehicle's box under the patch; give more than 0, 1 at most"
        )
    extent = replace(QUICK if quick else FULL, patch=patch)
    return run_bench(run, [load_detector(name) for name in detectors], extent, out, docs)


def run_bench(run: Path, detectors: Sequence[Detector], extent: Extent, out: Path, docs: Path | None = None) -> Results:
    """The same, of any extent."""
    defences = [make_defence(name) for name in defence_names()]
    views = read_views(run)
    everything = range(len(views.frames))
    with progress_bar("defences", resumes=False) as move:
        others = views.part(everything[1::2])
        patch = optimize_patch(detectors[0], others, extent.patch, extent.steps, _told(move, "patch"))
        held = views.part(everything[::2][: extent.views])
        held = held.with_paint("patch", paste(held.paints["normal"], held.boxes, patch, extent.patch))
        outcomes = _measure(held, defences, detectors, _told(move, "views"))
    height, width = held.paints["normal"].shape[2:]
    results = Results(len(held.frames), (height, width), detectors[0].name, extent.patch, extent.steps, outcomes)
    print_tables(grids(results), width=150)
    write_json(out, asdict(results))
    save_sheet(held, defences, out.with_suffix(".jpg"))
    if docs is not None:
        fill_page(docs / "defences.md", markdown_tables(grids(results)), "defences")
        save_sheet(held, defences, docs / "pictures" / "defences.jpg")
    return results


def _told(move: Callable[[Progress], None], stage: str) -> Callable[[int, int], None]:
    return lambda done, total: move(Progress(done, total, stage))


def _measure(
    views: Views, defences: Sequence[Defence], detectors: Sequence[Detector], progress: Callable[[int, int], None]
) -> tuple[Outcome, ...]:
    outcomes = []
    pairs = [(defence, paint) for defence in defences for paint in views.paints]
    for done, (defence, paint) in enumerate(pairs, start=1):
        images = views.paints[paint]
        started = time.process_time()
        defended = defence(images)
        cpu_ms = 1000 * (time.process_time() - started) / len(images)
        altered = ((defended - images).abs().amax(1) > ALTERED).float()
        ap, score = {}, {}
        for detector in detectors:
            ap[detector.name], score[detector.name] = _seen(detector, defended, views.boxes)
        on_vehicle = _mean_in_boxes(altered, views.boxes)
        whole = float(altered.mean())
        outcomes.append(Outcome(defence.name, defence.fingerprint, paint, cpu_ms, whole, on_vehicle, ap, score))
        progress(done, len(pairs))
    return tuple(outcomes)


@torch.no_grad()
def _seen(detector: Detector, images: Tensor, boxes: Tensor) -> tuple[float, float]:
    """AP@0.5 of class car and the mean best car score on the vehicle."""
    car, samples, scores = class_index(detector, "car"), [], []
    for start in range(0, len(images), BATCH):
        batch, truth = images[start : start + BATCH], boxes[start : start + BATCH]
        scores.append(car_score(detector, batch, truth))
        for box, found in zip(truth, detector.detect(batch, LOW_SCORE, NMS_IOU), strict=True):
            cars = found.labels == car
            samples.append(
                Sample(box.double().numpy(), found.boxes[cars].double().numpy(), found.scores[cars].double().numpy())
            )
    return average_precision(samples), float(torch.cat(scores).mean())


def _mean_in_boxes(values: Tensor, boxes: Tensor) -> float:
    """Mean over the boxes (B, 4) of the mean of (B, H, W) inside each."""
    parts = []
    for value, box in zip(values, boxes.round().int().tolist(), strict=True):
        left, top, right, bottom = (max(0, x) for x in box)
        parts.append(float(value[top:bottom, left:right].mean()))
    return float(np.mean(parts))
