"""A camera's sensor between light and detector: lens, exposure, noise, quantization, JPEG. Off unless it is asked for.

Everything up to the noise is differentiated exactly. Quantization and JPEG pass gradients straight through, as if they
changed nothing (Bengio et al., Estimating or Propagating Gradients Through Stochastic Neurons, 2013). Noise is that of
photons and of reading out, as in the EMVA 1288 standard: its variance grows with the light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..contract import RaucaError
from ..contract.seeding import named_rng
from ..render import linear_to_srgb
from ..render.straight_through import straight_through
from ..runtime.kernels import njit

BANK = 1 << 21  # normal draws, made once; a frame takes a part from a place of its own: drawing anew costs 3 ms
TABLE = 4096  # intervals of the square root of light; between their ends sRGB is straight to 1e-7
DARK_ELECTRONS = 0.1  # keeps the slope of the noise finite in the dark


@dataclass(frozen=True)
class Sensor:
    """What a camera does to light; every part is off at its default.

    Attributes:
        exposure_stops: powers of two by which the frame is made brighter.
        full_well: electrons at display white; fewer are noisier, 0 has no noise at all. A small sensor holds some 5000.
        read_noise: electrons (standard deviation) that reading out adds; some 2 to 10.
        bits: of the encoded value, 0: not quantized.
        jpeg_quality: 1 to 100, 0: not compressed. Compressed values have 8 bits.
        vignetting: share of the light that is lost in the corners.
        blur_px: standard deviation of the lens's blur, pixels.
    """

    exposure_stops: float = 0.0
    full_well: float = 0.0
    read_noise: float = 0.0
    bits: int = 0
    jpeg_quality: int = 0
    vignetting: float = 0.0
    blur_px: float = 0.0

    def __post_init__(self) -> None:
        limits = {
            "exposure_stops": (-16, 16), "full_well": (0, 1e6), "read_noise": (0, 1e3), "bits": (0, 16),
            "jpeg_quality": (0, 100), "vignetting": (0, 0.95), "blur_px": (0, 20),
        }  # fmt: skip
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise RaucaError(f"sensor: {name} must be from {low:g} to {high:g}, not {getattr(self, name):g}")
        if self.read_noise and not self.full_well:
            raise RaucaError("sensor: read_noise is in electrons; say with full_well how many of them are white")

    def __call__(self, light: Tensor, seed: int = 0) -> Tensor:
        """What the camera delivers.

        Args:
            light: (B, 3, H, W) linear, 1 is display white; more saturates.
            seed: of the noise; the same frame, seed and sensor give the same picture.

        Returns:
            (B, 3, H, W) sRGB in [0, 1].
        """
        if self.blur_px:
            light = _Blur.apply(light, self.blur_px)
        if light.device.type == "cpu" and light.dtype == torch.float32 and light[0].numel() <= BANK:
            picture = self._exposed_at_once(light, seed)
        else:
            picture = self._exposed(light, seed)
        if self.bits and not (self.bits == 8 and self.jpeg_quality):  # the encoder takes 8 bits itself
            levels = 2**self.bits - 1
            picture = straight_through(picture, (picture.detach() * levels).round() / levels)
        if self.jpeg_quality:
            picture = straight_through(picture, _jpeg(picture.detach(), self.jpeg_quality))
        return picture

    def _exposed(self, light: Tensor, seed: int) -> Tensor:
        """From what the lens lets through to sRGB: falloff, exposure, noise, encoding."""
        if self.vignetting:
            light = light * _falloff(light.shape[2], light.shape[3], self.vignetting, light.dtype, light.device)
        if self.exposure_stops:
            light = light * 2.0**self.exposure_stops
        if self.full_well:
            light = light + self._spread(light) * _noise(light, seed)
        return linear_to_srgb(light)

    def _exposed_at_once(self, light: Tensor, seed: int) -> Tensor:
        """The same in one pass over the pixels, with its slope: a third of the time. Off by less than 1e-6."""
        height, width = light.shape[2:]
        gain = _falloff(height, width, self.vignetting, light.dtype, light.device) * 2.0**self.exposure_stops
        begins = _begins(light, seed) if self.full_well else np.zeros(len(light), np.int64)
        noise = (
            (1 / self.full_well, (self.read_noise**2 + DARK_ELECTRONS**2) / self.full_well**2)
            if self.full_well
            else None
        )
        picture: Tensor = _Exposed.apply(light, gain, begins, noise)
        return picture

    def _spread(self, light: Tensor) -> Tensor:
        """Standard deviation of the noise, in units of white."""
        variance = light.clamp(min=0.0) / self.full_well + (self.read_noise**2 + DARK_ELECTRONS**2) / self.full_well**2
        return variance.sqrt()


class _Blur(torch.autograd.Function):
    """Gaussian, mirrored at the border: so it is its own adjoint, and the gradient is blurred like the light."""

    @staticmethod
    def forward(ctx: Any, light: Tensor, sigma: float) -> Tensor:
        ctx.sigma = sigma
        return blur(light, sigma)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return blur(gradients[0], ctx.sigma), None


def blur(light: Tensor, sigma: float, with_torch: bool = False) -> Tensor:
    """(B, 3, H, W), blurred to three standard deviations; by OpenCV on the CPU, by torch elsewhere."""
    reach = max(1, math.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    height, width = light.shape[2:]
    planes = light.detach().reshape(-1, 1, height, width)
    if light.device.type == "cpu" and not with_torch:
        depth = cv2.CV_64F if light.dtype == torch.float64 else cv2.CV_32F
        own = (plane[0].contiguous().numpy() for plane in planes)
        done = [cv2.sepFilter2D(plane, depth, kernel, kernel, borderType=cv2.BORDER_REFLECT) for plane in own]
        return torch.from_numpy(np.stack(done)).reshape(light.shape)
    weights = torch.from_numpy(kernel).to(light)
    for axis, size in ((2, height), (3, width)):
        place = np.pad(np.arange(size), reach, mode="symmetric")
        planes = planes.index_select(axis, torch.from_numpy(place).to(light.device))
        planes = functional.conv2d(planes, weights.view(1, 1, -1, 1) if axis == 2 else weights.view(1, 1, 1, -1))
    return planes.reshape(light.shape)


@cache
def _falloff(height: int, width: int, lost: float, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(H, W) share of the light that arrives: it falls with the fourth power of the angle's cosine."""
    rows, columns = (torch.linspace(-1.0, 1.0, n, dtype=torch.float64) for n in (height, width))
    squared = (rows[:, None] ** 2 + columns[None] ** 2) / 2  # 1 in the corners
    return ((1 + squared * ((1 - lost) ** -0.5 - 1)) ** -2).to(device, dtype)


@cache
def _bank() -> Tensor:
    return torch.from_numpy(named_rng("sensor noise").standard_normal(BANK, dtype=np.float32))


def _noise(light: Tensor, seed: int) -> Tensor:
    """Normal draws of the light's shape; each image of the batch has a part of the bank from a place of its own."""
    each = light[0].numel()
    if each > BANK:
        rng = named_rng("sensor", seed)
        drawn = torch.from_numpy(rng.standard_normal(tuple(light.shape), dtype=np.float32))
        return drawn.to(light)
    begins = _begins(light, seed).tolist()
    return torch.stack([_bank()[begin : begin + each].view(light.shape[1:]) for begin in begins]).to(light)


def _begins(light: Tensor, seed: int) -> NDArray[np.int64]:
    """(B,) where in the bank each image's noise begins."""
    return named_rng("sensor", seed).integers(0, BANK - light[0].numel() + 1, len(light))


class _Exposed(torch.autograd.Function):
    """Falloff, exposure, noise and sRGB of float32 light on the CPU; ``noise`` is (variance per light, in the dark)."""

    @staticmethod
    def forward(
        ctx: Any, light: Tensor, gain: Tensor, begins: NDArray[np.int64], noise: tuple[float, float] | None
    ) -> Tensor:
        source = light.detach().contiguous()
        picture, slope = torch.empty_like(source), torch.empty_like(source)
        planes = (t.view(*source.shape[:2], -1).numpy() for t in (source, picture, slope))
        bank = _bank().numpy() if noise else np.zeros(1, np.float32)
        shot, dark = noise or (0.0, 0.0)
        _expose(*planes, gain.reshape(-1).numpy(), bank, begins, np.float32(shot), np.float32(dark), *_encoding_table())
        ctx.save_for_backward(slope)
        return picture

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        return ctx.saved_tensors[0] * gradients[0], None, None, None


@cache
def _encoding_table() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """sRGB and its slope at square roots of light, evenly spaced in [0, 1], and one beyond."""
    with torch.enable_grad():
        light = torch.linspace(0.0, 1.0, TABLE + 1, dtype=torch.float64).square().requires_grad_()
        value = linear_to_srgb(light)
        (slope,) = torch.autograd.grad(value.sum(), light)
    both = (np.append(t.detach().numpy(), t.detach().numpy()[-1]).astype(np.float32) for t in (value, slope))
    return next(both), next(both)


@njit(cache=True, nogil=True)
def _expose(
    light: Any,
    picture: Any,
    slope: Any,
    gain: Any,
    bank: Any,
    begins: Any,
    shot: Any,
    dark: Any,
    values: Any,
    slopes: Any,
) -> None:
    """(B, 3, N) light -> picture and its slope; ``gain`` (N,)."""
    noisy, zero, one = dark > 0, np.float32(0.0), np.float32(1.0)
    for b in range(light.shape[0]):
        for c in range(3):
            start = begins[b] + c * light.shape[2]
            for i in range(light.shape[2]):
                x, rate = light[b, c, i] * gain[i], gain[i]
                if noisy:
                    draw = bank[start + i]
                    spread = np.sqrt(max(x, zero) * shot + dark)
                    if x > zero:
                        rate *= one + draw * shot / (np.float32(2.0) * spread)
                    x += spread * draw
                place = np.sqrt(min(max(x, zero), one)) * np.float32(TABLE)
                k = int(place)
                far = place - np.float32(k)
                picture[b, c, i] = values[k] + far * (values[k + 1] - values[k])
                inside = zero <= x <= one
                slope[b, c, i] = rate * (slopes[k] + far * (slopes[k + 1] - slopes[k])) if inside else zero


def _jpeg(pictures: Tensor, quality: int) -> Tensor:
    """(B, 3, H, W) sRGB through the encoder and back."""
    coded = [_recoded(picture, quality) for picture in (pictures * 255).round().to(torch.uint8).cpu()]
    return torch.stack([torch.from_numpy(one) for one in coded]).permute(0, 3, 1, 2).to(pictures) / 255


def _recoded(picture: Tensor, quality: int) -> NDArray[np.uint8]:
    """(3, H, W) -> (H, W, 3), 8 bits each."""
    pixels = cv2.cvtColor(np.ascontiguousarray(picture.permute(1, 2, 0).numpy()), cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB), np.uint8)
