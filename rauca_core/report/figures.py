"""Every figure of a report as SVG, which stays sharp at any zoom and needs no script; one color and mark per paint.

The colors are the same in every table and figure, told apart with any color vision and in print.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..study.recall import Around
from .table import Block, Table, is_normal, is_random

# Okabe and Ito's colors; the second of each pair is for dark pages.
GREY, OCHRE = ("#6b7280", "#a3abb6"), ("#b07d00", "#e0b04a")
PALETTE = (
    ("#0072b2", "#4aa8e0"), ("#d55e00", "#f08a3c"), ("#009e73", "#35c79c"), ("#b0578d", "#df92c0"),
    ("#3f8fc4", "#8fcbf2"), ("#7a6a00", "#d6c84a"),
)  # fmt: skip
COLORS = (GREY, OCHRE, *PALETTE)
MARKS = "os^Dvp*"  # matplotlib's: circle, square, triangle, diamond, ...


@dataclass(frozen=True)
class Style:
    """How a paint is drawn: its color on light and on dark pages, its mark, and its dashes."""

    light: str
    dark: str
    mark: str
    dashes: str = "-"


def paint_styles(paints: Iterable[str]) -> dict[str, Style]:
    """Grey for ``normal``, ochre for ``random``, colors in turn for camouflages, dashed when they come round again."""
    styles: dict[str, Style] = {}
    number = 0
    for paint in paints:
        if is_normal(paint):
            styles[paint] = Style(*GREY, MARKS[0])
        elif is_random(paint):
            styles[paint] = Style(*OCHRE, MARKS[1])
        else:
            turn, place = divmod(number, len(PALETTE))
            styles[paint] = Style(*PALETTE[place], MARKS[2 + number % (len(MARKS) - 2)], ("-", "--", ":")[turn % 3])
            number += 1
    return styles


def themed_color(light: str) -> str:
    """The page's name for a color, which stands for itself where the page defines none."""
    return f"var(--c-{light[1:]}, {light})"


def color_rules() -> str:
    """The style sheet that gives every color its darker-page twin."""
    rules = "".join(f"--c-{light[1:]}: {dark}; " for light, dark in COLORS)
    return f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {rules}}} }}"


INK, GRID = "#1c2128", "#dde1e6"
_STYLE: Any = {
    "font.size": 9.5,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GRID,
    "axes.facecolor": "none",
    "axes.labelcolor": INK,
    "figure.facecolor": "none",
    "xtick.color": GRID,
    "ytick.color": GRID,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "svg.hashsalt": "rauca",  # the same numbers make the same file
}
_SIZE = (4.0, 2.7)  # inches
_FEW_DIRECTIONS = 12  # bands between directions this far apart would cover each other; whiskers do not
_NAMES = {0: "front", 90: "left", 180: "rear", 270: "right"}


def curve_svg(curve: Table, styles: Mapping[str, Style], measure: str = "AP@0.5", legend: str = "") -> str:
    """A measure from 0 to 1 of every paint along the columns of ``curve``, whose names are numbers; intervals as bands.

    An azimuth of four values or more becomes a ring, with whiskers where its directions are few.

    Args:
        legend: its heading, for a picture that stands alone; without one, the page around it names the lines.
    """
    values = np.array([float(column.name) for column in curve.columns])
    with mpl.rc_context(_STYLE):
        if is_ring(curve):
            figure = _ring(curve.blocks[0], values, styles)
            _name_lines(figure, measure, legend)
            return _svg(figure)
        figure = Figure(figsize=_SIZE, layout="constrained")
        axes = figure.add_subplot()
        for paint, line, low, high in _lines(curve.blocks[0]):
            _draw(axes, values, line, low, high, styles[paint], paint)
        axes.set(ylim=(-0.02, 1.02), yticks=np.linspace(0, 1, 5), xlabel=curve.title, ylabel=measure)
        if len(values) == 1 or np.diff(values).min() > 0.09 * np.ptp(values):  # labels stay clear of each other
            axes.set_xticks(values, [f"{value:g}" for value in values])
        _name_lines(figure, "", legend)
        return _svg(figure)


_WIDEST_HEADING = 48  # characters of a legend's heading that fit into a plot's width


def _name_lines(figure: Figure, measure: str, heading: str) -> None:
    """A legend below the plot, in room of its own, if it has a heading; ``measure`` where no axis names it.

    White paper, too: alone, the picture may meet a dark page.
    """
    if not heading:
        return
    lines, names = figure.axes[0].get_legend_handles_labels()
    title = textwrap.fill(f"{measure}, {heading}" if measure else heading, _WIDEST_HEADING)
    height = 0.5 + 0.17 * title.count("\n")
    figure.set(figheight=figure.get_figheight() + height, facecolor="white")
    figure.legend(lines, names, loc="outside lower center", ncols=len(names), frameon=False, title=title)


def intervals_svg(table: Table, styles: Mapping[str, Style]) -> str:
    """A line per row of the table from the top, its scores as marks with their intervals as whiskers.

    ``styles`` has those of the columns to draw; where it has none of them, all are drawn in those of the rows.
    """
    rows, scores = table.blocks[0].rows, [place for place, one in enumerate(table.columns) if one.kind == "score"]
    scores = [place for place in scores if table.columns[place].name in styles] or scores
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.6, 0.7 + (0.16 + 0.12 * len(scores)) * len(rows)), layout="constrained")
        axes = figure.add_subplot()
        for line, row in enumerate(rows):
            for number, place in enumerate(scores):
                cell = row.cells[place]
                if cell is None or isinstance(cell.value, str):
                    continue
                at = line + 0.7 * (number + 1) / (len(scores) + 1)
                style = styles.get(table.columns[place].name) or styles[row.name]
                if cell.low is not None and cell.high is not None:
                    axes.hlines(at, cell.low, cell.high, color=style.light, lw=2.2, alpha=0.45)
                axes.plot(cell.value, at, style.mark, color=style.light, ms=5.5)
        axes.set(xlim=(-0.02, 1.02), xticks=np.linspace(0, 1, 6), xlabel="AP@0.5", ylim=(len(rows) - 0.1, -0.2))
        axes.set_yticks(np.arange(len(rows)) + 0.35, [row.name for row in rows])
        axes.grid(visible=False, axis="y")
        return _svg(figure)


def around_svg(views: Around) -> str:
    """A cell per side and distance: how many of its views find the target, the darker the fewer."""
    with mpl.rc_context({**_STYLE, "axes.grid": False}):
        figure = Figure(figsize=(4.0, 0.8 + 0.36 * len(views.bands)), layout="constrained")
        axes = figure.add_subplot()
        for (row, column), count in np.ndenumerate(views.views):
            if count:
                missed = 1 - float(views.found[row, column]) / float(count)
                axes.fill_between([column, column + 1], row, row + 1, color=PALETTE[1][0], alpha=0.65 * missed, lw=0)
                told = f"{views.found[row, column]}/{count}"
                axes.text(column + 0.5, row + 0.5, told, ha="center", va="center", fontsize=8)
        axes.set(xlim=(0, len(views.sides)), ylim=(len(views.bands), 0))
        axes.set_xticks(
            np.arange(len(views.sides)) + 0.5, [side.replace(" ", "\n") for side in views.sides], fontsize=7.5
        )
        axes.set_yticks(np.arange(len(views.bands)) + 0.5, views.bands, fontsize=8)
        return _svg(figure)


def is_ring(curve: Table) -> bool:
    return curve.title.startswith("Azimuth") and len(curve.columns) >= 4


def _ring(block: Block, degrees: NDArray[np.float64], styles: Mapping[str, Style]) -> Figure:
    figure = Figure(figsize=(4.0, 4.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    closed = [*range(len(degrees)), 0]
    around = np.radians(degrees[closed])
    for number, (paint, line, low, high) in enumerate(_lines(block)):
        if len(degrees) > _FEW_DIRECTIONS:
            _draw(axes, around, line[closed], low[closed], high[closed], styles[paint], paint)
            continue
        _draw(axes, around, line[closed], None, None, styles[paint], paint)
        beside, known = np.radians(degrees + 2.5 * (number - (len(block.rows) - 1) / 2)), np.isfinite(low)
        axes.vlines(beside[known], low[known], high[known], color=styles[paint].light, lw=1.1, alpha=0.65)
    axes.set_rlim(0, 1)
    axes.set_rticks([0.25, 0.5, 0.75, 1.0], labels=["", "0.5", "", "1"])
    axes.set_rlabel_position(22.5)
    axes.set_thetagrids(range(0, 360, 45), [_NAMES.get(angle, f"{angle}°") for angle in range(0, 360, 45)])
    axes.spines["polar"].set_color(GRID)
    return figure


def _draw(axes: Any, x: Any, line: Any, low: Any, high: Any, style: Style, name: str) -> None:
    if low is not None:
        axes.fill_between(x, low, high, color=style.light, alpha=0.14, lw=0)
    axes.plot(x, line, style.dashes, marker=style.mark, color=style.light, lw=1.7, ms=4.5, label=name)


def _lines(block: Block) -> list[tuple[str, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
    """Paint, values, and the lower and upper edge of its band; NaN where nothing was measured."""
    lines = []
    for row in block.rows:
        rows = [(c.value, c.low, c.high) if c is not None else (None, None, None) for c in row.cells]
        value, low, high = np.array(rows, np.float64).T
        lines.append((row.name, value, low, high))
    return lines


def history_svg(histories: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Training curves, one panel per camouflage: each term against the step."""
    with mpl.rc_context(_STYLE):
        columns = min(2, len(histories))
        rows = math.ceil(len(histories) / columns)
        figure = Figure(figsize=(4.6 * columns + 0.4, 2.6 * rows), layout="constrained")
        for index, (name, terms) in enumerate(histories.items(), start=1):
            axes = figure.add_subplot(rows, columns, index)
            for (color, _), (term, values) in zip(PALETTE * 3, terms.items(), strict=False):
                axes.plot(np.arange(1, len(values) + 1), values, color=color, lw=1.2, label=term)
            axes.set(xlabel="step", title=name)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", frameon=False)
        return _svg(figure)


def _svg(figure: Figure) -> str:
    """The picture's ``<svg>`` element alone."""
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return re.sub(r"^.*?(?=<svg)", "", stream.getvalue().decode(), flags=re.DOTALL)


def themed(svg: str) -> str:
    """The same picture in the page's colors, so that it follows the reader's choice of light or dark."""
    named = {INK: "currentColor", GRID: "var(--line)", **{light: themed_color(light) for light, _ in COLORS}}
    return re.sub("|".join(named), lambda found: named[found[0]], svg)
