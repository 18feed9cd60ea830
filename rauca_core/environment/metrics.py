"""How far a lit vehicle is from the truth, on the paint's pixels, in sRGB values."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..contract import Progress
from ..contract.color import Color, srgb_to_linear
from .extractor import LightSplitter
from .frames import LightFrame, LightFrames
from .losses import EPSILON
from .methods import AffineRender, Render, exact_render, plain_render, splitter_render, transfer_render

LEAST_MSE = 1e-10  # 100 dB: what float32 can tell apart


@dataclass(frozen=True)
class Error:
    """Sums over the values (pixels times channels) of paint; an error of 1 is the display's whole range.

    Attributes:
        values: how many.
        squared, absolute, entropy: sums of (p - q)^2, |p - q| and the binary cross-entropy of Eq. 5, unweighted.
    """

    values: int = 0
    squared: float = 0.0
    absolute: float = 0.0
    entropy: float = 0.0

    @staticmethod
    def between(seen: Tensor, truth: Tensor, paint: Tensor) -> Error:
        """Images (C, 3, H, W) sRGB on the pixels where ``paint`` (1, H, W) is above 0."""
        inside = paint[0] > 0
        p, q = seen[..., inside].double(), truth[..., inside].double()
        squeezed = EPSILON + (1 - 2 * EPSILON) * p
        entropy = -(q * squeezed.log() + (1 - q) * (1 - squeezed).log())
        return Error(p.numel(), float((p - q).square().sum()), float((p - q).abs().sum()), float(entropy.sum()))

    def __add__(self, other: Error) -> Error:
        mine, theirs = vars(self), vars(other)
        return Error(**{name: mine[name] + theirs[name] for name in mine})

    @property
    def mse(self) -> float:
        return self.squared / max(self.values, 1)

    @property
    def mae(self) -> float:
        return self.absolute / max(self.values, 1)

    @property
    def bce(self) -> float:
        return self.entropy / max(self.values, 1)

    @property
    def psnr_db(self) -> float:
        return -10 * math.log10(max(self.mse, LEAST_MSE))

    def to_json(self) -> dict[str, float]:
        """Rounded to what a reader can use; ``psnr_db`` is that of the mean squared error."""
        named = {"psnr_db": self.psnr_db, "mse": self.mse, "mae": self.mae, "bce": self.bce}
        return {name: float(f"{value:.5g}") for name, value in named.items()}


def total(errors: Iterable[Error]) -> Error:
    """The error over all values of several."""
    return sum(errors, Error())


def albedos(colors: Sequence[Color]) -> Tensor:
    """8-bit sRGB colors as linear albedo (C, 3, 1, 1)."""
    return torch.from_numpy(srgb_to_linear(np.array(colors) / 255.0))[:, :, None, None]


def measure(
    frames: LightFrames,
    indices: Sequence[int],
    render_of: Callable[[int, LightFrame], Render],
    colors: Sequence[Color],
) -> dict[str, Error]:
    """Errors in solid colors against the exact maps, per weather; frames without paint count for nothing."""
    found: dict[str, Error] = {}
    paints = albedos(colors)
    for index in indices:
        frame = frames.get(index)
        render, truth, paint = render_of(index, frame), exact_render(frame), frame.paint
        if isinstance(render, AffineRender):  # a tenth of the frame is paint: leave the rest out at once
            inside = paint[0] > 0
            render, truth, paint = render.where(inside), truth.where(inside), paint[:, inside][:, None]
        error = Error.between(render(paints), truth(paints), paint)
        found[frame.weather] = found.get(frame.weather, Error()) + error
    return found


ALL = "all"


def compare(
    folders: Sequence[Path], net: LightSplitter, colors: Sequence[Color], progress: Callable[[Progress], None]
) -> dict[str, dict[str, dict[str, float]]]:
    """Errors in solid colors.

    Returns:
        Per weather and for ``all``, per method (none, transfer, ours): ``psnr_db, mse, mae, bce``, and ``ms`` per
        image: from the image to its light maps, before any color.

    Raises:
        RaucaError: data sets without light maps, of several image sizes, or with composed frames.
    """
    frames = LightFrames(folders)
    for dataset in frames.datasets:
        dataset.require_rendered("extractors are judged on")
    methods: dict[str, Callable[[int, LightFrame], Render]] = {
        "none": lambda i, frame: plain_render(frame, frames.render_plain(i)),
        "transfer": lambda i, frame: transfer_render(frame),
        "ours": lambda i, frame: splitter_render(net, frame),
    }
    found: list[tuple[str, str, Error, float]] = []
    paints = albedos(colors)
    for index in range(len(frames)):
        frame = frames.get(index)
        truth = exact_render(frame)(paints)
        for name, method in methods.items():
            started = time.process_time()
            render = method(index, frame)
            spent = time.process_time() - started
            found.append((frame.weather, name, Error.between(render(paints), truth, frame.paint), spent))
        progress(Progress(index + 1, len(frames), frame.weather))
    table: dict[str, dict[str, dict[str, float]]] = {}
    for shown in [*sorted({weather for weather, *_ in found}), ALL]:
        table[shown] = {}
        for name in methods:
            rows = [row for row in found if row[1] == name and shown in (row[0], ALL)]
            ms = round(1e3 * sum(spent for *_, spent in rows) / len(rows), 3)
            table[shown][name] = {**total(error for _, _, error, _ in rows).to_json(), "ms": ms}
    return table
