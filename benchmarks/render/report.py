"""The run as a table, in the terminal or as Markdown, and as a plot of speed against error."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from rich.console import Console
from rich.table import Table

from rauca_core.contract.files import write_bytes

from .measure import Entry
from .results import Results
from .targets import judge
from .textures import TEXTURES
from .views import RINGS

matplotlib.use("Agg")
import matplotlib.pyplot as plt

Rows = list[tuple[str, ...]]
Grid = tuple[str, tuple[str, ...], Rows]  # title, headers, rows

WIDTH = 120  # a log has no terminal's width; the tables need this much
HEADERS = (
    "renderer", "noise, dB", "photo-like, dB", "forward, ms", "backward, ms", "build, ms", "taps per pixel",
    "texels reached",
)  # fmt: skip


def print_report(results: Results, path: Path | None = None) -> None:
    """Print every table; to ``path`` as Markdown instead, if given."""
    tables: list[Grid] = [
        (f"{vehicle}, {ring} ring, {size} px", HEADERS, rows)
        for vehicle in results.speedups
        for ring in RINGS
        for size in results.settings.sizes
        if (rows := _rows(results, vehicle, ring, size))
    ]
    targets: Rows = [
        (t.what, f"{'≤' if t.most else '≥'} {t.wanted:g} {t.unit}".strip(), f"{t.found:.4g}", _verdict(t.passed))
        for t in judge(results)
    ]
    tables.append((f"Targets ({results.main}, paper ring)", ("what", "wanted", "found", ""), targets))
    tables.append(("Once per step, and rasters", ("what", "ms"), _costs(results)))
    if path is not None:
        write_bytes(path, "\n".join(_markdown(*table) for table in tables).encode())
        return
    console = Console(width=max(Console().width, WIDTH))
    for title, headers, rows in tables:
        table = Table(*headers, title=title)
        for row in rows:
            table.add_row(*row)
        console.print(table)


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
        (f"{r.vehicle}, {r.ring} ring, {r.size} px: our raster; Embree", f"{r.ours_ms:.2f}; {r.embree_ms:.2f}")
        for r in results.raster
    ]
    return rows


def _markdown(title: str, headers: tuple[str, ...], rows: Rows) -> str:
    lines = [f"### {title}", "", "| " + " | ".join(headers) + " |", "|---" * len(headers) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _verdict(passed: bool) -> str:
    return "pass" if passed else "FAIL"


def save_plot(results: Results, path: Path) -> None:
    """Speed against error on the main vehicle at the largest size: a panel per ring, a curve per texture."""
    figure, panels = plt.subplots(1, len(RINGS), figsize=(10, 4.2), layout="constrained")
    size = max(results.settings.sizes)
    for axes, ring in zip(panels, RINGS, strict=True):
        for texture, marker in zip(TEXTURES, "os", strict=True):
            entries = [
                e
                for e in results.renderers
                if (e.vehicle, e.ring, e.size, e.texture) == (results.main, ring, size, texture)
            ]
            _draw(axes, [e for e in entries if e.name.startswith("ours")], f"ours, {texture}", marker, "-")
            _draw(axes, [e for e in entries if not e.name.startswith("ours")], f"others, {texture}", marker, "")
        axes.set(
            title=f"{results.main}, {ring} ring, {size} px", xscale="log",
            xlabel="forward + backward per image, ms, one core", ylabel="PSNR against 256 samples per pixel, dB",
        )  # fmt: skip
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)


def _draw(axes: plt.Axes, entries: list[Entry], label: str, marker: str, line: str) -> None:
    axes.plot([e.step_ms for e in entries], [e.psnr_db for e in entries], marker + line, label=label, markersize=5)
    for e in entries:
        axes.annotate(
            e.name.removeprefix("ours "), (e.step_ms, e.psnr_db), textcoords="offset points", xytext=(4, 4), fontsize=6
        )
