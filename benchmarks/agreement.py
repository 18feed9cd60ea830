"""The neural renderer's distance from Cycles on a data set's frames, over subsamples per pixel.

``rauca bench agreement DATASET --camouflage FILE`` runs it.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import matplotlib
from rich.table import Table

from pipelines.console import output
from pipelines.evaluate import render_camouflages
from pipelines.renderers import REFERENCE
from rauca_core.contract import Dataset, load_camouflage
from rauca_core.contract.files import write_json
from rauca_core.study.agreement import Agreement, measure_agreement

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def bench_agreement(dataset: Path, camouflage: Path, out: Path, samples: tuple[int, ...] = (1, 2, 4, 8)) -> None:
    """Measure each sample count on the same frames, in one process; writes ``out`` (.json) and a plot beside it."""
    renders = out.parent / f"{out.stem}-cycles"
    render_camouflages(dataset, [camouflage], renders, options=REFERENCE)
    folder = renders / load_camouflage(camouflage)[0].name
    opened = Dataset(dataset)
    measure_agreement(opened, camouflage, folder, samples=1)  # compiles the kernels, which is not what is measured
    measured = {n: measure_agreement(opened, camouflage, folder, samples=n) for n in samples}
    output().print(_table(measured))
    write_json(out, {"dataset": str(dataset), "samples": {n: asdict(a) for n, a in measured.items()}})
    _plot(measured, out.with_suffix(".png"))


def _table(measured: dict[int, Agreement]) -> Table:
    table = Table("samples", "build ms", "apply ms", "IoU mean", "IoU worst", "inside dB", "edge dB")
    for n, a in measured.items():
        figures = (a.build_ms, a.apply_ms, a.mean_iou, a.worst_iou, a.inside_db or 0, a.edge_db or 0)
        table.add_row(f"{n}x{n}", *(f"{x:.{d}f}" for x, d in zip(figures, (1, 1, 4, 4, 1, 1), strict=True)))
    return table


def _plot(measured: dict[int, Agreement], path: Path) -> None:
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    times = [a.build_ms for a in measured.values()]
    for label, values in (  # a data set without rendered frames has no PSNR
        ("inside the paint", [a.inside_db or float("nan") for a in measured.values()]),
        ("on its edges", [a.edge_db or float("nan") for a in measured.values()]),
    ):
        axes.plot(times, values, "o-", label=label)
    for n, a in measured.items():
        axes.annotate(f"{n}x{n}", (a.build_ms, a.inside_db or 0), textcoords="offset points", xytext=(4, 6))
    axes.set(xlabel="ms to build a view's taps, once", ylabel="PSNR against Cycles, dB", xscale="log")
    axes.legend()
    figure.savefig(path, dpi=130)
    plt.close(figure)
