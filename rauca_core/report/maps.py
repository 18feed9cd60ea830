"""The camouflages of a study as pictures of their UV maps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..contract import Camouflage, Dataset, load_camouflage
from ..runtime.images import read_image
from ..study.study import Entry
from .pictures import map_picture


def maps_of(entries: Sequence[Entry]) -> list[tuple[Camouflage, bytes]]:
    """Every camouflage once, with its UV map as JPEG, its paintable part outlined where the study names its views.

    Raises:
        RaucaError: a camouflage that is missing, damaged, or made for another UV atlas than the views' vehicle.
    """
    found = {path.resolve(): (path, entry) for entry in entries for path in entry.camouflages.values()}
    return [_map(path, entry) for path, entry in found.values()]


def _map(path: Path, entry: Entry) -> tuple[Camouflage, bytes]:
    camouflage, uv_map = load_camouflage(path)
    if entry.views is None:
        return camouflage, map_picture(uv_map, None)
    views = Dataset(entry.views)
    camouflage.check_fits(views.plan.atlas_id, str(path))
    return camouflage, map_picture(uv_map, read_image(views.vehicle_folder / "paint_mask.png"))
