"""Environment feature extractors: networks that split the light of one image into A and B. Ours, and the published one.

Ours knows the reference image I and the albedo r of its paint: A * r + B = I. All that is unknown is which share of the
light came back through the paint's color. The network predicts that share, B = (1 - share) * I and A = share * I / r,
per pixel and channel, in linear light. So

* the reference paint is reproduced exactly, whatever the network says, in channels that are not clipped;
* A has no upper bound, B is never negative, and a black frame gives black maps;
* the network is small: it learns a ratio, not an image.

Channels that the image clips hold less light than was there; a second output gives it back.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..render import saturate, srgb_to_linear

DARKEST_ALBEDO = 0.02  # a photograph's "black" paint; below, A = share * I / r would be noise
CLIPPED = 250.0 / 255.0
INPUTS = 13  # image (3), mask, clipped, exposure, darkness around (1) and anywhere (3), the reference's albedo (3)
MASK = 3  # channel of the mask among them
METERED = 0.2  # linear light that the paint's mean is exposed to for the network
DARKEST_LIGHT = 1e-3  # mean light of the paint, below which a frame stays as dark as it is
LEAST_COVERAGE = 1 / 255
DARK_SHARE = 0.01  # of the frame is darker than its darkness
AROUND = 15  # pixels, side of the square whose darkest pixel is told: in fog nothing is darker than the glow before it
WIDTHS = (64, 128, 256, 512, 1024)  # of the published network
BRIGHTEST = 16.0  # light in that exposure, beyond which nothing more is told


class LightSplitter(nn.Module):
    """Our network.

    Args:
        widths: channels at 1/2, 1/4, 1/8 and 1/16 of the image's size.
        detail: channels at full size.
    """

    def __init__(self, widths: tuple[int, ...] = (24, 40, 64, 96), detail: int = 12) -> None:
        super().__init__()
        self.widths, self.detail_width = widths, detail
        self.detail = _block(INPUTS, detail)
        sources = (detail, *widths[:-1])
        self.down = nn.ModuleList(_block(a, b, stride=2) for a, b in zip(sources, widths, strict=True))
        self.deep = nn.ModuleList(_block(b, b) for b in widths)
        self.globe = nn.Linear(2 * widths[-1], widths[-1])  # means of the frame, and of the paint
        targets = (*widths[-2::-1], detail)
        self.up = nn.ModuleList(_block(a + b, b) for a, b in zip(widths[::-1], targets, strict=True))
        self.head = nn.Conv2d(detail, 4, 3, padding=1)
        # A first guess: three quarters of what a grey car shows is diffuse, and clipped pixels are as they look.
        nn.init.zeros_(self.head.weight)
        with torch.no_grad():
            self.head.bias.copy_(torch.tensor([2.3, 2.3, 2.3, -4.0]))  # type: ignore[union-attr]

    def forward(self, image_srgb: Tensor, mask: Tensor, reference_linear: Tensor) -> tuple[Tensor, Tensor]:
        """Light maps of frames.

        Args:
            image_srgb: (B, 3, H, W) whole frames in the reference paint, in [0, 1].
            mask: (B, 1, H, W) coverage of the paint.
            reference_linear: (B, 3) albedo of the reference paint.

        Returns:
            A and B, (B, 3, H, W) linear float32; A is 0 where the mask is.
        """
        share, excess = self._predict(image_srgb, mask, reference_linear)
        image = srgb_to_linear(image_srgb.float())
        image = image * (1 + excess.float() * (image_srgb >= CLIPPED))
        through = share.float() * image * (mask > 0)
        reference = reference_linear.float()[:, :, None, None]
        albedo = reference.clamp(min=DARKEST_ALBEDO)
        return through / albedo, image - through * (reference / albedo)

    def _predict(self, image_srgb: Tensor, mask: Tensor, reference_linear: Tensor) -> tuple[Tensor, Tensor]:
        """The share of the light that came through the paint, (B, 3, H, W), and what clipping took, (B, 1, H, W)."""
        height, width = image_srgb.shape[-2:]
        tint = reference_linear.float().clamp(min=DARKEST_ALBEDO).log()[:, :, None, None]
        x = torch.cat([*_seen(image_srgb, mask), tint.expand(-1, -1, height, width)], dim=1)
        stride = 2 ** len(self.widths)
        x = nn.functional.pad(x, (0, -width % stride, 0, -height % stride))
        paint = x[:, MASK, None]
        skips = [self.detail(x)]
        for down, deep in zip(self.down, self.deep, strict=True):
            x = down(skips[-1])
            skips.append(x + deep(x))
        x = skips.pop()
        paint = nn.functional.adaptive_avg_pool2d(paint, x.shape[-2:])
        x = x + self.globe(torch.cat([x.mean(dim=(2, 3)), _mean_where(x, paint)], dim=1))[:, :, None, None]
        for up in self.up:
            skip = skips.pop()
            x = up(torch.cat([nn.functional.interpolate(x, scale_factor=2.0), skip], dim=1))
        out = self.head(x)[..., :height, :width]
        # share = A r / (A r + B) = sigmoid(log(A / B) + log r), and A grows with the coverage of an edge pixel: what
        # the network says depends on neither.
        known = tint + mask.float().clamp(min=LEAST_COVERAGE).log()
        return torch.sigmoid(out[:, :3] + known), nn.functional.softplus(out[:, 3:])


def _seen(image_srgb: Tensor, mask: Tensor) -> tuple[Tensor, ...]:
    """The frame in an exposure that makes its paint's mean light :data:`METERED`, so that nights look like days.

    Returns:
        Encoded image (B, 3, H, W); mask, where the image is clipped, the exposure in stops, (B, 1, H, W) each; how dark
        it gets around each pixel (B, 1, H, W), and in the frame, (B, 3, H, W).
    """
    linear = srgb_to_linear(image_srgb.float())
    light = _mean_where(linear, mask.float()).mean(dim=1)
    gain = METERED / light.clamp(min=DARKEST_LIGHT)
    exposed = (linear * gain[:, None, None, None]).clamp(max=BRIGHTEST).sqrt()
    stops = gain.log2()[:, None, None, None].expand_as(mask)
    around = -nn.functional.max_pool2d(-exposed.amin(dim=1, keepdim=True), AROUND, 1, AROUND // 2)
    pixels = exposed.flatten(2)
    darkness = pixels.kthvalue(1 + int(DARK_SHARE * (pixels.shape[-1] - 1)), dim=-1).values
    anywhere = darkness[:, :, None, None].expand_as(exposed)
    maps = (exposed, mask, _clipped(image_srgb), stops, around, anywhere)
    return tuple(m.to(image_srgb.dtype) for m in maps)


def _mean_where(x: Tensor, weight: Tensor) -> Tensor:
    """Mean (B, C) of maps (B, C, H, W), weighted by (B, 1, H, W); 0 where there is no weight."""
    return (x * weight).sum(dim=(2, 3)) / weight.sum(dim=(2, 3)).clamp(min=1e-3)


def _clipped(image_srgb: Tensor) -> Tensor:
    """(B, 1, H, W): 1 where the display's range ends before the light does."""
    return (image_srgb.amax(dim=1, keepdim=True) >= CLIPPED).to(image_srgb.dtype)


def _block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Convolution, group normalization (frames are few per batch) and SiLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, padding=1), nn.GroupNorm(4, outputs), nn.SiLU(inplace=True)
    )


class PublishedEfe(nn.Module):
    """The extractor as published: a U-Net on sRGB values, 34.5 million parameters.

    It reads the masked reference image and gives six channels through a sigmoid, two maps A and B. The textured vehicle
    of the plain neural renderer, x_nr, is then lit by :func:`fuse_published` (paper, Section III-C). Both maps end at
    1, so no pixel can come out brighter than the plain render plus one; light in the scene can.

    Args:
        widths: channels per level; the paper's by default, fewer for tests.
    """

    def __init__(self, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        self.widths = widths
        inputs = (3, *widths[:-1])
        self.down = nn.ModuleList(_double(a, b) for a, b in zip(inputs, widths, strict=True))
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.up = nn.ModuleList(_enlarge(a, b) for a, b in pairs)
        self.merge = nn.ModuleList(_double(2 * b, b) for _, b in pairs)
        self.head = nn.Conv2d(widths[0], 6, 1)
        self._stride = 2 ** (len(widths) - 1)

    def forward(self, masked_srgb: Tensor) -> tuple[Tensor, Tensor]:
        """Masked reference image (B, 3, H, W) sRGB -> maps A and B, (B, 3, H, W) each in [0, 1].

        H and W are padded up to a multiple of 16 inside.
        """
        height, width = masked_srgb.shape[-2:]
        below, right = -height % self._stride, -width % self._stride
        x = nn.functional.pad(masked_srgb, (0, right, 0, below))
        skips = []
        for level, block in enumerate(self.down):
            x = block(x if level == 0 else nn.functional.max_pool2d(x, 2))
            skips.append(x)
        for enlarge, merge, skip in zip(self.up, self.merge, skips[-2::-1], strict=True):
            x = merge(torch.cat([skip, enlarge(x)], dim=1))
        maps = torch.sigmoid(self.head(x))[..., :height, :width]
        return maps[:, :3], maps[:, 3:]


def fuse_published(x_nr_srgb: Tensor, A: Tensor, B: Tensor) -> Tensor:
    """``clamp(x_nr * A + B, 0, 1)`` in sRGB values; shapes broadcast."""
    return saturate(x_nr_srgb * A + B)


def _double(inputs: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for a in (inputs, outputs):
        layers += [nn.Conv2d(a, outputs, 3, padding=1), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


def _enlarge(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Upsample(scale_factor=2),
        nn.Conv2d(inputs, outputs, 3, padding=1),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )
