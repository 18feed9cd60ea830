"""The report's main figures as files, for a README or a talk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..contract import Dataset, load_camouflage
from ..contract.files import write_bytes
from ..images import read_image
from .grid import picture_grid
from .pictures import map_picture
from .plots import curve_svg
from .results import AXES, load_results


def save_showcase(
    results_path: Path, dataset: Dataset, camouflages: Sequence[Path], detector: str, folder: Path
) -> list[Path]:
    """Write ``grid.jpg``, ``map-<name>.png`` and, per axis varied, ``ap-<axis>.svg``; returns their paths."""
    results = load_results(results_path)
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "grid.jpg"]
    picture_grid(results, results_path.parent, detector).sheet().save(written[0], quality=88)
    mask = read_image(dataset.vehicle_folder / "paint_mask.png")
    for path in camouflages:
        record, uv_map = load_camouflage(path)
        written.append(folder / f"map-{record.name}.png")
        write_bytes(written[-1], map_picture(uv_map, mask))
    for axis in AXES:
        if len(results.groups[axis]) > 1:
            written.append(folder / f"ap-{axis.partition('_')[0]}.svg")
            write_bytes(written[-1], curve_svg(results, axis))
    return written
