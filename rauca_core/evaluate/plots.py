"""Curves of the report as SVG, so that they stay sharp at any zoom and need no script."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .results import Group, Results

# Okabe and Ito's palette: told apart with any colour vision.
PALETTE = ("#4d4d4d", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#b3a100")
AXIS_TITLES = {
    "azimuth_deg": "Azimuth (°), 0 = front",
    "elevation_deg": "Camera elevation (°)",
    "distance_m": "Distance (m)",
    "sun_altitude_deg": "Sun altitude (°)",
    "fog_density": "Fog density (CARLA, 0-100)",
}
_STYLE: Any = {
    "font.size": 10,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#9aa3ae",
    "axes.labelcolor": "#1d2430",
    "xtick.color": "#5b6675",
    "ytick.color": "#5b6675",
    "grid.color": "#e6eaee",
    "axes.grid": True,
    "axes.axisbelow": True,
    "svg.hashsalt": "rauca",  # the same numbers make the same file
}


def paint_colours(results: Results) -> dict[str, str]:
    """One colour per paint, the same in every plot and table."""
    return {paint: PALETTE[i % len(PALETTE)] for i, paint in enumerate(results.paints)}


def curve_svg(results: Results, axis: str) -> bytes:
    """AP@0.5 (mean over detectors) of every paint against an axis of :data:`AXIS_TITLES`; azimuth becomes a ring."""
    with mpl.rc_context(_STYLE):
        if axis == "azimuth_deg" and len(results.groups[axis]) >= 4:
            return _svg(_ring(results))
        figure = Figure(figsize=(4.6, 3.1), layout="constrained")
        axes = figure.add_subplot()
        groups = results.groups[axis]
        for paint, colour in paint_colours(results).items():
            axes.plot([g.value for g in groups], _means(groups, paint), "o-", color=colour, lw=2, ms=4.5, label=paint)
        axes.set(ylim=(-0.03, 1.03), xlabel=AXIS_TITLES[axis], ylabel="AP@0.5")
        return _svg(figure)


def _ring(results: Results) -> Figure:
    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    groups = results.groups["azimuth_deg"]
    around = np.radians([g.value for g in groups] + [groups[0].value])
    for paint, colour in paint_colours(results).items():
        values = _means(groups, paint)
        axes.plot(around, [*values, values[0]], "o-", color=colour, lw=2, ms=4, label=paint)
    axes.set_rlim(0, 1)
    axes.set_rticks([0.25, 0.5, 0.75, 1.0], labels=["", "0.5", "", "1"])
    axes.set_rlabel_position(67.5)
    axes.set_thetagrids(range(0, 360, 45), ["front", "45°", "left", "135°", "rear", "225°", "right", "315°"])
    axes.spines["polar"].set_color("#c8ced6")
    return figure


def history_svg(histories: Mapping[str, Mapping[str, Sequence[float]]]) -> bytes:
    """Training curves, one panel per camouflage: each term against the step."""
    with mpl.rc_context(_STYLE):
        columns = min(2, len(histories))
        rows = math.ceil(len(histories) / columns)
        figure = Figure(figsize=(4.6 * columns + 0.4, 2.9 * rows), layout="constrained")
        for index, (name, terms) in enumerate(histories.items(), start=1):
            axes = figure.add_subplot(rows, columns, index)
            for colour, (term, values) in zip(PALETTE * 3, terms.items(), strict=False):
                axes.plot(np.arange(1, len(values) + 1), values, color=colour, lw=1.6, label=term)
            axes.set(xlabel="step", title=name)
            axes.legend(frameon=False, fontsize=9)
        return _svg(figure)


def _means(groups: Sequence[Group], paint: str) -> list[float]:
    return [float(np.mean(list(group.ap[paint].values()))) for group in groups]


def _svg(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()
