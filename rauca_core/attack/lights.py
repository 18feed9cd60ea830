"""Where the light of a frame comes from: exact, or one of the estimates it is compared with.

All of them are affine in the texture, but not in the same numbers: light proper adds up in linear values; Neural
Renderer's shading, and what was built on it, in sRGB values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Dataset, Frame, RaucaError, Vehicle
from ..contract.color import linear_to_srgb, srgb_to_linear, to_bytes
from ..environment import Light, estimate, load_exact, load_extractor
from ..environment.extractor import PublishedEfe
from ..environment.frames import read_picture
from ..environment.methods import transfer_light
from ..environment.place_light import PlaceLight
from ..environment.shading import PlainShading, plain_shading
from ..environment.weights import load_published

LightName = Literal["exact", "irradiance", "ours", "published", "transfer", "none"]


@dataclass(frozen=True, eq=False)
class LightSource:
    """A way to light frames.

    Attributes:
        linear: the image is ``linear_to_srgb(A * x + B)``; else ``A * linear_to_srgb(x) + B``, sRGB values.
        of: the light of one frame, and the frame itself (H, W, 3) uint8 sRGB, in the reference paint; raises
            :class:`RaucaError` when its files are missing or damaged.
    """

    linear: bool
    of: Callable[[Frame], tuple[Light, NDArray[np.uint8]]]


def light_source(
    name: LightName, dataset: Dataset, vehicle: Vehicle, extractor: Path | None, device: torch.device | str
) -> LightSource:
    """The source of that name.

    Args:
        name: ``exact`` maps; ``irradiance``, the same with the paint's light from its texture; ``ours``, the
            extractor's estimate; ``published``, that of the paper's; ``transfer`` of color without training; ``none``,
            Neural Renderer's own shading.
        extractor: weights of ours, the shipped ones if None; or of the published one, which must be given.
        device: of the extractors; the maps come back to the computer's memory.

    Raises:
        RaucaError: no usable weights; light that is not fitted yet.
    """
    size, reference = dataset.plan.size, srgb_to_linear(np.array(dataset.plan.reference_srgb) / 255.0)

    def image_of(frame: Frame) -> NDArray[np.uint8]:
        return read_picture(dataset.frame_folder(frame.id) / "image.png", size).permute(1, 2, 0).numpy()

    def coverage_of(frame: Frame, of: str) -> Tensor:
        return read_picture(dataset.frame_folder(frame.id) / of, size, grey=True).float() / 255

    def exact(frame: Frame) -> tuple[Light, NDArray[np.uint8]]:
        light = load_exact(dataset, frame.id)
        return light, to_bytes(linear_to_srgb(light.A * reference + light.B))

    def irradiance(frame: Frame) -> tuple[Light, NDArray[np.uint8]]:
        light = places.light_of(frame)
        return light, to_bytes(linear_to_srgb(light.A * reference + light.B))

    def ours(frame: Frame) -> tuple[Light, NDArray[np.uint8]]:
        return estimate(dataset, frame.id, net), image_of(frame)

    def transfer(frame: Frame) -> tuple[Light, NDArray[np.uint8]]:
        image, paint = image_of(frame), coverage_of(frame, "paint.png")
        linear = torch.from_numpy(srgb_to_linear(image / 255.0).astype(np.float32)).permute(2, 0, 1)
        return _maps(*transfer_light(linear, paint, torch.from_numpy(reference).float())), image

    def none(frame: Frame) -> tuple[Light, NDArray[np.uint8]]:
        image, plain = image_of(frame), plain_shading(vehicle, frame.camera_in_vehicle)
        behind = torch.from_numpy(image / np.float32(255)).permute(2, 0, 1) * (1 - plain.coverage)
        return _maps(plain.paint.expand(3, -1, -1), plain.rest + behind), image

    def published(frame: Frame) -> tuple[Light, NDArray[np.uint8]]:
        image, plain = image_of(frame), plain_shading(vehicle, frame.camera_in_vehicle)
        return published_light(teacher, image, coverage_of(frame, "vehicle.png"), plain), image

    if name == "irradiance":
        places = PlaceLight(dataset)
        for frame in dataset.frames():
            if frame.box_xyxy is not None:
                places.require(*frame.place_and_weather)
    if name == "ours":
        net = load_extractor(extractor)[0].to(device)
    if name == "published":
        if extractor is None:
            told = "train them with `rauca efe published DATASET --out FOLDER`, and give --extractor FILE"
            raise RaucaError(f"light: published needs weights of its own; {told}")
        teacher = load_published(extractor).to(device)
    sources = {
        "exact": exact,
        "irradiance": irradiance,
        "ours": ours,
        "published": published,
        "transfer": transfer,
        "none": none,
    }
    return LightSource(name not in ("none", "published"), sources[name])


def published_light(net: PublishedEfe, image: NDArray[np.uint8], vehicle: Tensor, plain: PlainShading) -> Light:
    """``clamp(x_nr * A + B)`` of the published extractor as maps of the paint's sRGB values.

    The network is taught images with a black background, so its own are dark by coverage already, and the frame shines
    through where the vehicle covers a pixel in part.

    Args:
        image: (H, W, 3) sRGB, in the reference paint.
        vehicle: (1, H, W) coverage.
    """
    device, seen = next(net.parameters()).device, torch.from_numpy(image / np.float32(255)).permute(2, 0, 1)
    with torch.no_grad():
        A, B = (m[0].cpu() for m in net((seen * vehicle)[None].to(device)))
    inside = vehicle > 0
    paint = A * plain.paint * inside
    rest = (A * plain.rest + B) * inside + seen * (1 - vehicle)
    return _maps(paint, rest)


def _maps(A: Tensor, B: Tensor) -> Light:
    """Of maps (3, H, W)."""
    return Light(A.permute(1, 2, 0).numpy(), B.permute(1, 2, 0).numpy())
