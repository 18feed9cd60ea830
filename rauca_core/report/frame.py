"""A study's numbers as a data frame, for a notebook."""

from __future__ import annotations

import importlib.util
from typing import Any

from ..study.study import Study


def frame_of(study: Study) -> Any:
    """A row per vehicle, weathers, defence, paint and detector, with ``"mean"`` as the last detector of each paint.

    Returns:
        A `pandas.DataFrame` where pandas is installed, else a list of dicts with the same names: ``vehicle``,
        ``weathers``, ``defence``, ``paint``, ``detector``, ``ap`` (AP@0.5, 0 to 1), ``low`` and ``high`` (its 95 %
        interval) and ``n`` (frames).
    """
    rows = [
        {
            "vehicle": entry.vehicle, "weathers": entry.weathers, "defence": entry.defence, "paint": paint,
            "detector": detector, "ap": found.ap, "low": found.low, "high": found.high,
            "n": len(entry.results.frames),
        }
        for entry in study.entries
        for paint, row in entry.results.table.items()
        for detector, found in row.items()
    ]  # fmt: skip
    if importlib.util.find_spec("pandas") is None:
        return rows
    import pandas

    return pandas.DataFrame(rows)
