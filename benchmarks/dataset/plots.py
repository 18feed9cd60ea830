"""Cost against error, and composed fog against its thickness, as SVG."""

from __future__ import annotations

from pathlib import Path

import matplotlib

from .results import MAPS, SINGLE, Entry, Results
from .settings import KINDS
from .targets import COMPOSED_DB, PSNR_DB

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLORS = 9  # that share a frame's light maps, in the paper's set
METHODS = {"real": "real volume", "composed": "composed around the vehicle", "everywhere": "composed everywhere",
           "formula": "transmittance and airlight"}  # fmt: skip


def save_pareto(results: Results, path: Path) -> None:
    """A panel per kind of weather: CPU seconds per frame in one color against display PSNR."""
    figure, panels = plt.subplots(1, len(KINDS), figsize=(12, 4.2), layout="constrained", sharey=True)
    for axes, kind in zip(panels, KINDS, strict=True):
        entries = results.of_kind(kind)
        _draw(axes, "one render a color, denoised", "C0", "-", _chosen(entries, SINGLE, "samples"), 1)
        _draw(axes, "one render a color, raw", "C7", ":", _chosen(entries, SINGLE, "raw"), 1)
        _draw(axes, f"light maps, {COLORS} colors, denoised", "C1", "-", _chosen(entries, MAPS, "samples"), COLORS)
        _draw(axes, "light maps, raw", "C5", ":", _chosen(entries, MAPS, "raw"), COLORS)
        _draw(axes, "light maps, adaptive", "C2", "", _chosen(entries, MAPS, "adaptive"), COLORS)
        _draw(axes, "light maps, other bounces", "C4", "", _chosen(entries, MAPS, "bounces"), COLORS)
        _draw(axes, "light maps, fog the other way", "C6", "", _chosen(entries, MAPS, "fog"), COLORS)
        default = results.at_default(kind)
        axes.plot(default.cpu_seconds / COLORS, default.psnr_db, "*", color="C3", markersize=13, label="default")
        axes.axhline(PSNR_DB[kind], color="0.6", linewidth=0.8, linestyle="--")
        axes.set(title=kind, xscale="log", xlabel="CPU seconds per frame in one color")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("PSNR against a converged render, display values, dB")
    panels[0].legend(fontsize=7)
    _save(figure, path)


def save_fog_curve(results: Results, path: Path) -> None:
    """A panel per light: display PSNR against the fog's extinction, by method."""
    lights = list(dict.fromkeys(point.light for point in results.fog_curve))
    figure, panels = plt.subplots(1, len(lights), figsize=(9, 3.8), layout="constrained", sharey=True, squeeze=False)
    for axes, light in zip(panels[0], lights, strict=True):
        points = sorted((p for p in results.fog_curve if p.light == light), key=lambda p: p.extinction)
        for method, label in METHODS.items():
            values = [getattr(point, f"{method}_db") for point in points]
            axes.plot([point.extinction for point in points], values, marker="o", markersize=4, label=label)
        axes.axhline(COMPOSED_DB, color="0.6", linewidth=0.8, linestyle="--")
        axes.set(title=light, xscale="log", xlabel="extinction, 1/m")
        axes.grid(alpha=0.3)
    panels[0][0].set_ylabel("PSNR, display values, dB")
    panels[0][0].legend(fontsize=7)
    _save(figure, path)


def _chosen(entries: list[Entry], what: str, axis: str) -> list[Entry]:
    chosen = [entry for entry in entries if (entry.what, entry.axis) == (what, axis)]
    return sorted(chosen, key=lambda entry: entry.cpu_seconds)


def _draw(axes: plt.Axes, label: str, color: str, line: str, entries: list[Entry], shared_by: int) -> None:
    if not entries:
        return
    x, y = [e.cpu_seconds / shared_by for e in entries], [e.psnr_db for e in entries]
    axes.plot(x, y, marker="o", markersize=4, linestyle=line, color=color, label=label)
    for entry, at in zip(entries, zip(x, y, strict=True), strict=True):
        axes.annotate(note(entry), at, textcoords="offset points", xytext=(4, -8), fontsize=6, color="0.3")


def note(entry: Entry) -> str:
    """What sets an entry apart within its series."""
    if entry.axis == "adaptive":
        return f"≤{entry.adaptive_threshold:g}"
    if entry.axis == "bounces":
        return f"{entry.bounces} bounces"
    if entry.axis == "fog":
        return "composed" if entry.composed_fog else "real"
    return str(entry.samples)


def _save(figure: plt.Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)
