"""The truth: two converged Cycles renders of the textured car, of different seeds.

The product of the errors against each has, on average, no noise of either. Renders are kept on disk by what they show.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.console import progress_bar
from rauca_core.contract import Camouflage, Dataset, Vehicle, save_camouflage
from rauca_core.contract.color import linear_to_srgb, to_bytes
from rauca_core.contract.files import png_bytes
from rauca_core.contract.seeding import named_rng
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.metrics import Error
from rauca_core.render import Pyramid, build_taps, srgb_to_linear
from rauca_core.runtime.images import read_image

from .harness import Settings
from .in_blender import run_child
from .render_agreement import to_image
from .render_reference import uv_map

SOLID = 250 / 255  # coverage above which a pixel is inside the paint; below, on its edge
SEEDS = (101, 202)
SAMPLES_PER_AXIS = 12  # of our renderer
LIGHT = "light"
SATURATED = "saturated"  # the texture of the figures
TEXTURES = ("noise", "photograph-like", SATURATED)  # that no extractor was taught
CELL = 4  # texels; finer noise is grey from where cameras stand
SATURATED_CELL = 16


def texture(kind: str, pyramid: Pyramid) -> NDArray[np.uint8]:
    """A UV map (size, size, 3), 8-bit sRGB, gutters filled."""
    if kind == "photograph-like":
        return to_bytes(linear_to_srgb(uv_map(kind, pyramid)))
    cell = CELL if kind == "noise" else SATURATED_CELL
    drawn = named_rng("bench environment", kind).random((-(-pyramid.size // cell),) * 2 + (3,), np.float32)
    if kind == "saturated":
        # As in the published texture, 80 % of the values are at an end of the range.
        drawn = np.clip((drawn - 0.5) * 5 + 0.5, 0, 1)
    whole = drawn.repeat(cell, 0).repeat(cell, 1)[: pyramid.size, : pyramid.size]
    texels = pyramid.from_map(torch.from_numpy(whole.transpose(2, 0, 1).copy()))
    return to_bytes(linear_to_srgb(pyramid.to_map(texels.pow(2.2)).permute(1, 2, 0).numpy()))


def save_textures(vehicle: Vehicle, size: int, folder: Path) -> dict[str, Path]:
    pyramid, paths = Pyramid.of(vehicle, size), {}
    for kind in TEXTURES:
        paths[kind] = folder / kind / "camouflage.json"
        record = Camouflage(kind, vehicle.name, vehicle.atlas_id, size, "benchmark")
        save_camouflage(paths[kind], record, png_bytes(texture(kind, pyramid)))
    return paths


class Budget(NamedTuple):
    """A frame, in a camouflage or as light maps; the whole of it, or where it shows paint."""

    frame: str
    paint: str
    samples: int
    seed: int = 1
    denoise: bool = False
    whole: bool = False


def render_anew(
    dataset: Dataset, camouflages: Mapping[str, Path], wanted: Sequence[Budget], folder: Path
) -> dict[Budget, dict[str, Any]]:
    """Arrays of every render, see `environment_in_blender`; those already in ``folder`` are read."""
    paths = {render: folder / f"{_name(dataset, camouflages, render)}.npz" for render in wanted}
    weather_of = {frame.id: frame.place_and_weather for frame in dataset.frames()}
    missing = sorted((r for r in paths if not paths[r].is_file()), key=lambda r: (weather_of[r.frame], r.paint, r))
    if missing:
        jobs = [{**render._asdict(), "name": paths[render].stem} for render in missing]
        request = {
            "dataset": str(dataset.folder.absolute()),
            "camouflages": {name: str(path.absolute()) for name, path in camouflages.items()},
            "out": str(folder.absolute()),
            "jobs": jobs,
        }
        with progress_bar("Cycles", resumes=False) as move:
            run_child("environment_in_blender.main", request, move)
    found = {}
    for render, path in paths.items():
        with np.load(path) as archive:
            found[render] = dict(archive)
    return found


def _name(dataset: Dataset, camouflages: Mapping[str, Path], render: Budget) -> str:
    painted = "" if render.paint == LIGHT else hashlib.sha256(
        camouflages[render.paint].with_suffix(".png").read_bytes()
    ).hexdigest()  # fmt: skip
    text = json.dumps([dataset.plan.to_json(), painted, *render], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


@dataclass(frozen=True, eq=False)
class Truth:
    """One frame in one texture, rendered twice (3, H, W) in sRGB."""

    index: int  # of the frame in the test set
    texture: str
    albedo: Tensor  # (1, 3, H, W) linear, the texture at each pixel, normalized by coverage, from our renderer's taps
    first: Tensor
    second: Tensor

    def error(self, seen: Tensor, where: Tensor) -> Error:
        """Of an image (3, H, W) sRGB where ``where`` (1, H, W) is True; the squared one is free of renders' noise."""
        inside = where[0]
        mean = (self.first + self.second) / 2
        found = Error.between(seen[None], mean[None], where)
        squared = ((seen - self.first) * (seen - self.second))[:, inside].double().sum()
        return Error(found.values, float(squared), found.absolute, found.entropy)


def near_frames(frames: LightFrames) -> list[int]:
    """The nearest view of every weather: the ones that are rendered textured."""
    chosen: dict[str, int] = {}
    for i in sorted(range(len(frames.places)), key=lambda i: frames.places[i].frame.distance_m):
        chosen.setdefault(frames.places[i].frame.weather.name, i)
    return sorted(chosen.values())


def find_truths(frames: LightFrames, camouflages: Mapping[str, Path], settings: Settings, folder: Path) -> list[Truth]:
    dataset, chosen = frames.datasets[0], near_frames(frames)
    ids = {i: frames.places[i].frame.id for i in chosen}
    pairs = {
        (i, name): [Budget(ids[i], name, settings.reference_samples, seed) for seed in SEEDS]
        for i in chosen
        for name in TEXTURES
    }
    rendered = render_anew(dataset, camouflages, [render for pair in pairs.values() for render in pair], folder)
    albedo = sample_textures(frames, chosen, camouflages, settings.uv_size)
    return [
        Truth(*key, albedo[key], *(displayed(rendered[render]["image"]) for render in pair))
        for key, pair in pairs.items()
    ]


def sample_textures(
    frames: LightFrames, chosen: Sequence[int], camouflages: Mapping[str, Path], uv_size: int
) -> dict[tuple[int, str], Tensor]:
    """Textures at the pixels of frames, (1, 3, H, W) linear albedo each."""
    pyramid = Pyramid.of(frames.vehicle(chosen[0]), uv_size)
    texels, found = {}, {}
    for name, path in camouflages.items():
        uv_map = torch.from_numpy(read_image(path.with_suffix(".png")).astype(np.float32) / 255).permute(2, 0, 1)
        texels[name] = pyramid(srgb_to_linear(pyramid.from_map(uv_map)))
    for i in chosen:
        camera = frames.places[i].frame.camera_in_vehicle
        taps = build_taps(frames.vehicle(i), camera, uv_size, SAMPLES_PER_AXIS, pyramid=pyramid)
        for name, levels in texels.items():
            found[i, name] = to_image(taps, taps.rows(levels))[None]
    return found


def displayed(linear: np.ndarray) -> Tensor:
    """(H, W, 3) linear -> (3, H, W) sRGB."""
    return torch.from_numpy(linear_to_srgb(linear).transpose(2, 0, 1).copy())


def regions(dataset: Dataset, frame_id: str) -> dict[str, Tensor]:
    """Pixels (1, H, W) of all paint, inside it, and on its edges."""
    coverage = torch.from_numpy(read_image(dataset.frame_folder(frame_id) / "paint.png").astype(np.float32) / 255)[None]
    return {"paint": coverage > 0, "inside": coverage > SOLID, "edge": (coverage > 0) & (coverage <= SOLID)}
