"""The truth: converged Cycles renders of the textured car, with their own noise taken out of the figures.

A render of a few hundred raw samples is still 40 dB from the truth, where exact maps are. So there are two of them, of
different seeds: the product of the errors against each has, on average, no noise of either in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rauca_core.contract import Dataset
from rauca_core.contract.color import linear_to_srgb
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.metrics import Error
from rauca_core.render import Pyramid, build_taps
from rauca_core.runtime.images import read_image

from .cycles import Render, render_anew
from .settings import Settings
from .textures import TEXTURES, texels_of

SOLID = 250 / 255  # coverage above which a pixel is inside the paint; below, on its edge
SEEDS = (101, 202)
SAMPLES_PER_AXIS = 12  # of our renderer


@dataclass(frozen=True, eq=False)
class Truth:
    """One frame in one texture.

    Attributes:
        index: of the frame in the test set.
        texture: its name.
        albedo: (1, 3, H, W) linear, the texture at each pixel, normalized by coverage, from our renderer's taps.
        first, second: (3, H, W) sRGB, two renders of the same.
    """

    index: int
    texture: str
    albedo: Tensor
    first: Tensor
    second: Tensor

    def error(self, seen: Tensor, where: Tensor) -> Error:
        """Of an image (3, H, W) sRGB, on the pixels ``where`` (1, H, W) is True.

        The squared error is free of the renders' noise; the others are against their mean.
        """
        inside = where[0]
        mean = (self.first + self.second) / 2
        found = Error.between(seen[None], mean[None], where)
        squared = ((seen - self.first) * (seen - self.second))[:, inside].double().sum()
        return Error(found.values, float(squared), found.absolute, found.entropy)


def near_frames(frames: LightFrames) -> list[int]:
    """The nearest view of every weather: the ones that are rendered textured."""
    chosen: dict[str, int] = {}
    for i, place in enumerate(frames.places):
        best = chosen.get(place.frame.weather.name)
        if best is None or place.frame.distance_m < frames.places[best].frame.distance_m:
            chosen[place.frame.weather.name] = i
    return sorted(chosen.values())


def find_truths(frames: LightFrames, camouflages: Mapping[str, Path], settings: Settings, folder: Path) -> list[Truth]:
    """Render the near frames of the test set in every texture."""
    dataset, chosen = frames.datasets[0], near_frames(frames)
    ids = {i: frames.places[i].frame.id for i in chosen}
    wanted = [
        Render(ids[i], name, settings.reference_samples, seed) for i in chosen for name in TEXTURES for seed in SEEDS
    ]
    rendered = render_anew(dataset, camouflages, wanted, folder)
    albedo = sample_textures(frames, chosen, camouflages, settings.uv_size)
    return [
        Truth(i, name, albedo[i, name], *(
            displayed(rendered[Render(ids[i], name, settings.reference_samples, seed)]["image"]) for seed in SEEDS
        ))
        for i in chosen
        for name in TEXTURES
    ]  # fmt: skip


def sample_textures(
    frames: LightFrames, chosen: Sequence[int], camouflages: Mapping[str, Path], uv_size: int
) -> dict[tuple[int, str], Tensor]:
    """Textures at the pixels of frames, (1, 3, H, W) linear albedo each."""
    pyramid = Pyramid.of(frames.vehicle(chosen[0]), uv_size)
    texels = {name: texels_of(read_image(path.with_suffix(".png")), pyramid) for name, path in camouflages.items()}
    found = {}
    for i in chosen:
        camera = frames.places[i].frame.camera_in_vehicle
        taps = build_taps(frames.vehicle(i), camera, uv_size, SAMPLES_PER_AXIS, pyramid=pyramid)
        for name, levels in texels.items():
            found[i, name] = taps.to_image(taps.rows(levels), torch.zeros(3, camera.height, camera.width))[None]
    return found


def displayed(linear: np.ndarray) -> Tensor:
    """(H, W, 3) linear -> (3, H, W) sRGB."""
    return torch.from_numpy(linear_to_srgb(linear).transpose(2, 0, 1).copy())


def regions(dataset: Dataset, frame_id: str) -> dict[str, Tensor]:
    """Pixels (1, H, W) of all paint, inside it, and on its edges."""
    coverage = torch.from_numpy(read_image(dataset.frame_folder(frame_id) / "paint.png").astype(np.float32) / 255)[None]
    return {"paint": coverage > 0, "inside": coverage > SOLID, "edge": (coverage > 0) & (coverage <= SOLID)}
