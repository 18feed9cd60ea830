"""``rauca bench agreement``: how far the neural renderer is from Cycles on a data set's frames.

Coverage and color are compared, frame by frame.
"""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean, median

import numpy as np
import torch

from pipelines.console import progress_bars
from rauca_core.contract import Dataset, Frame, RaucaError, load_camouflage, load_vehicle
from rauca_core.environment import load_exact
from rauca_core.render import Pyramid, Taps, TapSettings, build_taps, composite, linear_to_srgb, srgb_to_linear
from rauca_core.render.cache import tap_key
from rauca_core.runtime.images import read_image
from rauca_core.study import recipes
from rauca_core.study.engine import Engine
from rauca_core.study.store import Store, store_around

from .figures import Line, Panel, save_figure
from .harness import Results, Settings, psnr_db

# Of the frames, one in so many is rendered anew in the camouflage; unfiltered and with many samples, since a denoised
# render of few is further from the truth than the prediction that it judges. Three does not divide the number: three
# weathers take turns.
REFERENCE_EVERY, REFERENCE_SAMPLES = 23, 128
DB = ("inside_db", "edge_db")
SOLID = 250 / 255  # paint coverage above which a pixel counts as inside; below, as edge
MOST_DB = 100.0  # of a frame without a difference


def bench(out: Path, dataset: Path, camouflage: Path, samples: tuple[int, ...] = (1, 2, 4, 8)) -> Results:
    """Measure each number of samples per pixel and axis on the same frames."""
    opened = Dataset(dataset)
    opened.require_rendered("renderers are compared on")
    frames = [frame.id for frame in opened.frames()[::REFERENCE_EVERY]]
    views, paint = recipes.views_in(dataset), recipes.camouflage_in(camouflage, camouflage.stem)
    with progress_bars() as on_progress:
        engine = Engine(Store(out.parent / f"{out.stem}-cycles", store_around(dataset)), on_progress=on_progress)
        (folder,) = engine.make(recipes.renders(views, paint, frames, REFERENCE_SAMPLES))
    results = Results("agreement", Settings(dataset=str(dataset), samples=samples))
    measure_agreement(opened, camouflage, folder, samples=1)  # compiles the kernels, which is not what is measured
    for n in samples:
        results.add("samples", name=f"{n}x{n}", **asdict(measure_agreement(opened, camouflage, folder, samples=n)))
    rows = results.rows["samples"]
    for row in rows:  # a data set without rendered frames has no PSNR
        row |= {key: float("nan") for key in ("inside_db", "edge_db") if row[key] is None}
    columns = {
        "samples": "{name}", "build ms": "{build_ms:.1f}", "apply ms": "{apply_ms:.1f}", "IoU mean": "{mean_iou:.4f}",
        "IoU worst": "{worst_iou:.4f}", "inside dB": "{inside_db:.1f}", "edge dB": "{edge_db:.1f}",
    }  # fmt: skip
    results.table("The neural renderer against Cycles", columns, rows)
    lines = [
        Line(label, [(row["build_ms"], row[key], row["name"]) for row in rows])
        for label, key in (("inside the paint", "inside_db"), ("on its edges", "edge_db"))
    ]
    axes = "ms to build a view's taps, once", "PSNR against Cycles, dB"
    results.picture(lambda path: save_figure(path, [Panel("", lines)], *axes, 6), ".png", "agreement.png")
    results.publish(out)
    return results


@dataclass(frozen=True)
class FrameAgreement:
    """One frame: intersection over union of the paint at half coverage; PSNR in display space, dB, where rendered.

    ``build_ms`` is of the taps, which frames of one camera share.
    """

    frame: str
    iou: float
    inside_db: float | None
    edge_db: float | None
    build_ms: float
    apply_ms: float


@dataclass(frozen=True)
class Agreement:
    """Over the frames: means of overlap and PSNR, the worst overlap, the usual times; and the frames."""

    mean_iou: float
    worst_iou: float
    inside_db: float | None
    edge_db: float | None
    build_ms: float
    apply_ms: float
    frames: list[FrameAgreement]


def measure_agreement(dataset: Dataset, camouflage: Path, renders: Path, samples: int = 12) -> Agreement:
    """Compare the neural renderer with Cycles on a data set with light maps.

    Args:
        camouflage: JSON of the texture to compare in.
        renders: folder of ``<frame id>.png``, the same camouflage rendered by Cycles; frames without one are compared
            by coverage alone.
        samples: subsamples per pixel along each axis.

    Raises:
        RaucaError: no frames, composed ones, or a camouflage of another vehicle.
    """
    dataset.require_rendered("renderers are compared on")
    vehicle = load_vehicle(dataset.vehicle_folder, read_image)
    record, image = load_camouflage(camouflage)
    record.check_fits(vehicle.atlas_id, str(camouflage))
    pyramid = Pyramid.of(vehicle, record.size)
    uv_map = torch.from_numpy(read_image(image).astype(np.float32) / 255).permute(2, 0, 1)
    texels = pyramid(srgb_to_linear(pyramid.from_map(uv_map)))
    frames = [frame for frame in dataset.frames() if frame.box_xyxy is not None]
    if not frames:
        raise RaucaError(f"{dataset.folder}: no finished frame shows the vehicle; make the data set first")
    views: defaultdict[str, list[Frame]] = defaultdict(list)
    for frame in frames:  # the taps of one camera serve all weathers, and building them takes the time
        settings = TapSettings(pyramid.size, samples)
        views[tap_key(vehicle.geometry_id, frame.camera_in_vehicle, settings)].append(frame)
    by_id: dict[str, FrameAgreement] = {}
    for view in views.values():
        started = time.perf_counter()
        taps = build_taps(vehicle, view[0].camera_in_vehicle, pyramid.size, samples, pyramid=pyramid)
        build_ms = 1e3 * (time.perf_counter() - started)
        by_id |= {frame.id: _compare(dataset, frame, taps, texels, renders, build_ms) for frame in view}
    rows = [by_id[frame.id] for frame in frames]
    inside, edge = ([value for row in rows if (value := getattr(row, name)) is not None] for name in DB)
    return Agreement(
        mean_iou=mean(row.iou for row in rows),
        worst_iou=min(row.iou for row in rows),
        inside_db=mean(inside) if inside else None,
        edge_db=mean(edge) if edge else None,
        build_ms=median(row.build_ms for row in rows),
        apply_ms=median(row.apply_ms for row in rows),
        frames=rows,
    )


def _compare(
    dataset: Dataset, frame: Frame, taps: Taps, texels: torch.Tensor, renders: Path, build_ms: float
) -> FrameAgreement:
    folder, light = dataset.frame_folder(frame.id), load_exact(dataset, frame.id)
    started = time.perf_counter()
    A, B = (torch.from_numpy(m.reshape(-1, 3)) for m in (light.A, light.B))
    pixels = torch.from_numpy(taps.pixels.astype(np.int64))
    paint = linear_to_srgb(composite(taps.rows(texels), A[pixels], B[pixels]))
    predicted = linear_to_srgb(B).index_copy(0, pixels, paint).reshape(taps.height, taps.width, 3).numpy()
    apply_ms = 1e3 * (time.perf_counter() - started)
    coverage = read_image(folder / "paint.png") / np.float32(255)
    ours, theirs = taps.coverage() >= 0.5, coverage >= 0.5
    iou = float((ours & theirs).sum() / max((ours | theirs).sum(), 1))
    rendered = renders / f"{frame.id}.png"
    inside = edge = None
    if rendered.is_file():
        error = (read_image(rendered) / np.float32(255) - predicted) ** 2
        regions = error[coverage > SOLID], error[(coverage > 0) & (coverage <= SOLID)]
        inside, edge = (psnr_db(region, MOST_DB) if region.size else None for region in regions)
    return FrameAgreement(frame.id, iou, inside, edge, build_ms, apply_ms)
