"""What exact maps cost: their error against seconds, for the first texture and the tenth, beside rendering each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

import torch

from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import AffineRender
from rauca_core.environment.metrics import Error, total

from .cycles import LIGHT, Render, render_anew
from .settings import Settings
from .truth import Truth, displayed, regions

TEXTURE = "saturated"


@dataclass(frozen=True)
class Point:
    """One budget in one weather.

    Attributes:
        weather, samples: of the renders, denoised.
        maps_db, render_db: inside the paint, of exact maps and of the textured car itself.
        maps_edge_db: of exact maps, on the paint's edges.
        maps_s, render_s: CPU seconds per frame; of the maps, once for all textures.
    """

    weather: str
    samples: int
    maps_db: float
    render_db: float
    maps_s: float
    render_s: float
    maps_edge_db: float

    def seconds(self, textures: int) -> float:
        """Of the maps, per texture."""
        return self.maps_s / textures


def measure_curve(
    frames: LightFrames, truths: Sequence[Truth], camouflages: Mapping[str, Path], settings: Settings, folder: Path
) -> list[Point]:
    """Render the truth's frames at every budget, both ways, and compare."""
    chosen = [truth for truth in truths if truth.texture == TEXTURE]
    ids = {truth.index: frames.places[truth.index].frame.id for truth in chosen}
    wanted = [
        _render(frame, paint, samples)
        for frame in ids.values()
        for samples in settings.budgets
        for paint in (LIGHT, TEXTURE)
    ]
    rendered = render_anew(frames.datasets[0], camouflages, wanted, folder)
    points = []
    for weather in dict.fromkeys(frames.get(i).weather for i in ids):
        for samples in settings.budgets:
            maps: list[tuple[Error, float]] = []
            edges: list[Error] = []
            renders: list[tuple[Error, float]] = []
            for truth in (t for t in chosen if frames.get(t.index).weather == weather):
                where = regions(frames.datasets[0], ids[truth.index])
                inside = where["inside"]
                light = rendered[_render(ids[truth.index], LIGHT, samples)]
                A, B = (torch.from_numpy(light[name].transpose(2, 0, 1).copy()) for name in ("A", "B"))
                seen = AffineRender(A, B)(truth.albedo)[0]
                maps.append((truth.error(seen, inside), float(light["seconds"])))
                edges.append(truth.error(seen, where["edge"]))
                car = rendered[_render(ids[truth.index], TEXTURE, samples)]
                renders.append((truth.error(displayed(car["image"]), inside), float(car["seconds"])))
            maps_db, render_db = (total(error for error, _ in found).psnr_db for found in (maps, renders))
            maps_s, render_s = (mean(s for _, s in found) for found in (maps, renders))
            points.append(Point(weather, samples, maps_db, render_db, maps_s, render_s, total(edges).psnr_db))
    return points


def _render(frame: str, paint: str, samples: int) -> Render:
    """Denoised, and of the whole frame: what a data set would pay for it."""
    return Render(frame, paint, samples, 1, True, True)
