"""The run as a table, in the terminal or as Markdown, and as a plot of speed against error."""

from __future__ import annotations

from pathlib import Path

import matplotlib

from benchmarks.tables import Grid, Rows, markdown_tables, print_tables

from .contenders import ALGORITHM_2
from .results import Results
from .targets import judge
from .textures import TEXTURES
from .views import RINGS

matplotlib.use("Agg")
import matplotlib.pyplot as plt

WIDTH = 120  # what the widest table needs
HEADERS = (
    "renderer", "noise, dB", "photo-like, dB", "forward, ms", "backward, ms", "build, ms", "taps per pixel",
    "texels reached",
)  # fmt: skip


def print_report(results: Results) -> None:
    """Print every table."""
    print_tables(_tables(results, list(results.levels), results.settings.sizes), WIDTH)


def markdown_report(results: Results) -> str:
    """The main vehicle at the largest size, targets and costs, as Markdown."""
    return markdown_tables(_tables(results, [results.main], (max(results.settings.sizes),)))


def _tables(results: Results, vehicles: list[str], sizes: tuple[int, ...]) -> list[Grid]:
    tables: list[Grid] = [
        (f"{vehicle}, {ring} ring, {size} px", HEADERS, _rows(results, vehicle, ring, size))
        for vehicle in vehicles
        for ring in RINGS
        for size in sizes
    ]
    if results.rival:
        size = max(results.settings.sizes)
        tables.append(
            (f"{results.rival}, paper ring, {size} px", HEADERS, _rows(results, results.rival, "paper", size))
        )
    targets: Rows = [
        (t.what, f"{'≤' if t.most else '≥'} {t.wanted:g} {t.unit}".strip(), f"{t.found:.4g}", _verdict(t.passed))
        for t in judge(results)
    ]
    tables.append((f"Targets ({results.main}, paper ring)", ("what", "wanted", "found", ""), targets))
    reached: Rows = [(name, f"{100 * share:.4f} %") for name, share in results.reach.items()]
    title = f"Visible texels that receive gradient: {results.main}, {results.settings.reach_views} views"
    tables.append((title, ("renderer", "reached"), reached))
    tables.append(("What else costs time", ("what", "ms"), _costs(results)))
    return tables


def _rows(results: Results, vehicle: str, ring: str, size: int) -> Rows:
    chosen = [e for e in results.renderers if (e.vehicle, e.ring, e.size) == (vehicle, ring, size)]
    noise, photograph = ([e for e in chosen if e.texture == texture] for texture in TEXTURES)
    return [
        (
            a.name, f"{a.psnr_db:.1f}", f"{b.psnr_db:.1f}", f"{a.forward_ms:.2f}", f"{a.backward_ms:.2f}",
            f"{a.build_ms:.0f}", f"{a.taps_per_pixel:.1f}", f"{100 * a.reached:.2f} %",
        )
        for a, b in zip(noise, photograph, strict=True)
    ]  # fmt: skip


def _costs(results: Results) -> Rows:
    rows: Rows = [
        (f"{name}: mip levels from the UV map, and back", f"{step.forward_ms:.1f} + {step.backward_ms:.1f}")
        for name, step in results.levels.items()
    ]
    for name, s in results.speedups.items():
        rows.append(
            (f"{name}: Algorithm 2, one view", f"{s.algorithm2_forward_ms:.0f} + {s.algorithm2_backward_ms:.0f}")
        )
        rows.append((f"{name}: ours 2x2, the same view", f"{s.ours_forward_ms:.2f} + {s.ours_backward_ms:.2f}"))
        rows.append((f"{name}: times as fast; with mip levels, one image", f"{s.operator:.0f}; {s.whole_step:.0f}"))
    rows += [
        (
            f"{r.vehicle}, {r.ring} ring, {r.size} px: our raster; Embree through trimesh; bare",
            f"{r.ours_ms:.2f}; {r.trimesh_ms:.2f}; {r.embree_ms:.2f}",
        )
        for r in results.raster
    ]
    return rows


def _verdict(passed: bool) -> str:
    return "pass" if passed else "FAIL"


def save_plot(results: Results, path: Path) -> None:
    """Speed against error on the main vehicle at the largest size: a panel per ring, a color per texture."""
    figure, panels = plt.subplots(1, len(RINGS), figsize=(10, 4.2), layout="constrained")
    size = max(results.settings.sizes)
    for axes, ring in zip(panels, RINGS, strict=True):
        for texture, color in zip(TEXTURES, ("C0", "C1"), strict=True):
            entries = [
                e
                for e in results.renderers
                if (e.vehicle, e.ring, e.size, e.texture) == (results.main, ring, size, texture)
            ]
            points = [(e.name, e.step_ms, e.psnr_db) for e in entries]
            ours = [point for point in points if point[0].startswith("ours")]
            others = [point for point in points if point not in ours]
            if ring == "paper":
                step = results.speedups[results.main].algorithm2_ms
                others += [("as published", step, psnr) for name, _, psnr in others if name == ALGORITHM_2]
            _draw(axes, ours, f"ours, {texture}", marker="o", linestyle="-", color=color)
            _draw(axes, others, f"others, {texture}", marker="o", linestyle="", color=color, fillstyle="none")
        axes.margins(x=0.22)
        axes.set(
            title=f"{results.main}, {ring} ring, {size} px", xscale="log",
            xlabel="forward + backward per image, ms, one core", ylabel="PSNR against 256 samples per pixel, dB",
        )  # fmt: skip
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)


def _draw(axes: plt.Axes, points: list[tuple[str, float, float]], label: str, **style: str) -> None:
    axes.plot([x for _, x, _ in points], [y for _, _, y in points], label=label, markersize=5, **style)  # type: ignore[arg-type]
    for name, x, y in points:
        axes.annotate(
            name.removeprefix("ours "), (x, y), textcoords="offset points", xytext=(5, 3), fontsize=6, color="0.3"
        )
