"""Results of images that were drawn and not rendered: what a study does with its detections, on a folder of PNGs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract import Dataset
from rauca_core.detect import Detector
from rauca_core.study.average_precision import Sample
from rauca_core.study.detecting import Pictures, detect_in, image_of
from rauca_core.study.detection_cache import DetectionCache, DetectionSettings
from rauca_core.study.results import AXES, Estimate, FrameRow, Group, ImageRow, Results
from rauca_core.study.scores import score_table, tabulate

FRAMES, PLACES, BOX = 24, 8, (10.0, 10.0, 50.0, 40.0)


def measure(
    dataset: Dataset,
    renders: Mapping[str, Path],
    detectors: Sequence[Detector],
    out: Path,
    only: Collection[str] | None = None,
    defence: str = "none",
    settings: DetectionSettings | None = None,
) -> Results:
    """Results of paints whose images lie in a data set's folder or in one of ``<frame id>.png``."""
    every = [frame for frame in dataset.frames() if only is None or frame.id in only]
    frames = [frame for frame in every if frame.box_xyxy is not None]
    kept = settings or DetectionSettings()
    caches = {one.name: DetectionCache(out / "detections", one.name, one.fingerprint, kept) for one in detectors}
    paints = {}
    for paint, folder in renders.items():
        paints[paint] = Pictures.of(frames, [image_of(folder, frame.id) for frame in frames])
        detect_in(paints[paint], [(one, caches[one.name]) for one in detectors], "cpu")
    dropped = tuple(frame.id for frame in every if frame.box_xyxy is None)
    return tabulate(dataset, paints, dict.fromkeys(paints, caches), out, defence, dropped)


def made_up(seed: int, paints: tuple[str, ...], detectors: tuple[str, ...]) -> Results:
    """Numbers of no meaning, all different."""
    rng = np.random.default_rng(seed)

    def estimate(ap: float) -> Estimate:
        return Estimate(ap, ap * 0.9, min(1.0, ap * 1.1))

    table = {}
    for paint in paints:
        table[paint] = {name: estimate(float(rng.random())) for name in detectors}
    frames = tuple(FrameRow(f"f{i}", "clear", 90.0 * i, 10, 6, 45, 0, (0, 0, 9, 9), i, i) for i in range(4))
    ap = {paint: {name: row[name].ap for name in detectors} for paint, row in table.items()}
    azimuths = tuple(Group(90.0 * i, 1, ap) for i in range(4))
    return Results(
        dataset="made up",
        settings=DetectionSettings(),
        detectors=dict.fromkeys(detectors, "0" * 64),
        frames=frames,
        dropped=(),
        table=table,
        groups={axis: azimuths if axis == "azimuth_deg" else (Group(1.0, 4, ap),) for axis in AXES},
        images={paint: tuple(ImageRow(f"{i}.png", "0") for i in range(4)) for paint in paints},
    )


def found_in(hit: NDArray[np.bool_]) -> list[Sample]:
    """Of :data:`FRAMES` views: a box on the target where it is found, and one beside it everywhere."""
    wrong = (60.0, 60.0, 80.0, 80.0)
    return [Sample(np.array(BOX), np.array([BOX, wrong][not one :]), np.array([0.9, 0.3][not one :])) for one in hit]


def scored(samples: Mapping[str, Mapping[str, list[Sample]]]) -> Results:
    """Results of what :func:`found_in` gave for each paint and detector, over :data:`PLACES` locations."""
    rows = tuple(FrameRow(f"f{i}", "clear", 0, 10, 6, 45, 0, BOX, i % PLACES, i) for i in range(FRAMES))
    return Results(
        "made up", DetectionSettings(), dict.fromkeys(next(iter(samples.values())), "0" * 64), rows, (),
        score_table(samples, rows), dict.fromkeys(AXES, ()),
        {paint: (ImageRow("x.png", "0"),) * FRAMES for paint in samples}, place_kind="locations", place_count=PLACES,
    )  # fmt: skip
