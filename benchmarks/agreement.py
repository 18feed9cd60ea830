"""``rauca bench agreement``: the neural renderer's distance from Cycles on a data set's frames."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from pipelines.console import progress_bars
from rauca_core.contract import Dataset
from rauca_core.study import recipes
from rauca_core.study.engine import Engine
from rauca_core.study.store import Store, store_around

from .figures import Line, Panel, save_figure
from .harness import Results, Settings
from .renderer_agreement import measure_agreement

# Of the frames, one in so many is rendered anew in the camouflage; unfiltered and with many samples, since a denoised
# render of few is further from the truth than the prediction that it judges. The number is odd, so that weathers take
# turns.
REFERENCE_EVERY, REFERENCE_SAMPLES = 23, 128


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
