"""The report's main figures as files, for a README or a talk."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from ..contract import Dataset, load_camouflage
from ..contract.files import write_bytes
from ..images import read_image
from .grid import picture_grid
from .pictures import map_picture
from .plots import curve_svg
from .results import AXES, Results, load_results


def save_showcase(
    results_path: Path, dataset: Dataset, camouflages: Sequence[Path], detector: str, folder: Path
) -> list[Path]:
    """Write ``grid.jpg``, ``table.md``, a ``map-<name>.jpg`` each and, per axis varied, ``ap-<axis>.svg``."""
    results = load_results(results_path)
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "grid.jpg"]
    picture_grid(results, results_path.parent, detector).sheet().save(written[0], quality=88)
    written.append(folder / "table.md")
    write_bytes(written[-1], _markdown(results).encode())
    mask = read_image(dataset.vehicle_folder / "paint_mask.png")
    for path in camouflages:
        record, uv_map = load_camouflage(path)
        written.append(folder / f"map-{record.name}.jpg")
        Image.open(io.BytesIO(map_picture(uv_map, mask))).convert("RGB").save(written[-1], quality=85)
    for axis in AXES:
        if len(results.groups[axis]) > 1:
            written.append(folder / f"ap-{axis.partition('_')[0]}.svg")
            write_bytes(written[-1], curve_svg(results, axis))
    return written


def _markdown(results: Results) -> str:
    """AP@0.5 of every paint and detector with its 95 % interval."""
    columns = list(next(iter(results.table.values())))
    lines = ["| paint | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for paint, row in results.table.items():
        cells = (f"{row[name].ap:.3f} ({row[name].low:.2f}-{row[name].high:.2f})" for name in columns)
        lines.append(f"| {paint} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
