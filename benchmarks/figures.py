"""Figures of benchmarks: plots of cost against quality, and sheets of pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from numpy.typing import NDArray

matplotlib.use("Agg")
import matplotlib.pyplot as plt


class Line(NamedTuple):
    """A line of a figure: points of x, y and a note beside the point; ``style`` is matplotlib's."""

    label: str
    points: Sequence[tuple[float, float, str]]
    style: Mapping[str, Any] = {}


class Panel(NamedTuple):
    """One plot of a figure; ``level`` is a value of y that is hoped for."""

    title: str
    lines: Sequence[Line]
    level: float | None = None


def save_figure(path: Path, panels: Sequence[Panel], x: str, y: str, width: float = 4.5, share: bool = True) -> None:
    """Plots of ``width`` inches side by side: x, what it costs, logarithmic; y, how well it does, one axis for all.

    One legend below them holds every line's label once.
    """
    size = (width * len(panels), 4.6)
    figure, plots = plt.subplots(1, len(panels), figsize=size, layout="constrained", sharey=share, squeeze=False)
    for axes, panel in zip(plots[0], panels, strict=True):
        for line in panel.lines:
            style = {"marker": "o", "markersize": 4, **line.style}
            axes.plot([p[0] for p in line.points], [p[1] for p in line.points], label=line.label, **style)
            for at_x, at_y, note in line.points:
                axes.annotate(note, (at_x, at_y), (5, -8), textcoords="offset points", fontsize=6, color="0.3")
        if panel.level is not None:
            axes.axhline(panel.level, color="0.6", linewidth=0.8, linestyle="--")
        axes.margins(x=0.15)
        axes.set(title=panel.title, xscale="log", xlabel=x)
        axes.tick_params(axis="x", which="both", labelsize=7)
        axes.grid(alpha=0.3)
    plots[0][0].set_ylabel(y)
    named: dict[str, Artist] = {}
    for axes in plots[0]:
        named |= {label: line for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=len(panels), fontsize=7)
    figure.savefig(path)
    plt.close(figure)


def save_sheet(path: Path, rows: Mapping[str, Mapping[str, NDArray[np.float32]]]) -> None:
    """Pictures (H, W, 3) in [0, 1] beside each other, by the name of their row and of their column."""
    columns = max(len(pictures) for pictures in rows.values())
    size = (2 * columns, 2 * len(rows) + 0.3)
    figure, plots = plt.subplots(len(rows), columns, figsize=size, layout="constrained", squeeze=False)
    for row, (name, pictures) in enumerate(rows.items()):
        plots[row][0].set_ylabel(name)
        for axes, (title, picture) in zip(plots[row], pictures.items(), strict=True):
            axes.imshow(picture)
            axes.set(xticks=[], yticks=[], title="" if row else title)
    figure.savefig(path, dpi=108)
    plt.close(figure)
