"""Our environment feature extractor: how to split the light of one image into A and B.

The reference image I is known, and so is the albedo r of its paint: A * r + B = I. All that is unknown is which share
of the light came back through the paint's colour. The network predicts that share, B = (1 - share) * I and
A = share * I / r, per pixel and channel, in linear light. So

* the reference paint is reproduced exactly, whatever the network says;
* A has no upper bound, B is never negative, and a black frame gives black maps;
* the network is small: it learns a ratio, not an image.

Pixels that the image clips hold less light than was there; a second output gives it back.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..render.composite import undisplay

DARKEST_ALBEDO = 0.02  # a photograph's "black" paint; below, A = share * I / r would be noise
CLIPPED = 250.0 / 255.0
INPUTS = 6  # image (3), mask, clipped, and the frame's mean light spread over it


class LightSplitter(nn.Module):
    """The network.

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
        self.globe = nn.Linear(widths[-1], widths[-1])
        targets = (*widths[-2::-1], detail)
        self.up = nn.ModuleList(_block(a + b, b) for a, b in zip(widths[::-1], targets, strict=True))
        self.head = nn.Conv2d(detail, 4, 3, padding=1)
        # A first guess: most of what a grey car shows is diffuse light, and clipped pixels are as they look.
        nn.init.zeros_(self.head.weight)
        with torch.no_grad():
            self.head.bias.copy_(torch.tensor([1.0, 1.0, 1.0, -4.0]))  # type: ignore[union-attr]

    def forward(self, image_srgb: Tensor, mask: Tensor, reference_linear: Tensor) -> tuple[Tensor, Tensor]:
        """Light maps of frames.

        Args:
            image_srgb: (B, 3, H, W) whole frames in the reference paint, in [0, 1].
            mask: (B, 1, H, W) coverage of the paint.
            reference_linear: (B, 3) albedo of the reference paint.

        Returns:
            A and B, (B, 3, H, W) linear float32; A is 0 where the mask is.
        """
        share, excess = self._predict(image_srgb, mask)
        image = undisplay(image_srgb.float())
        image = image * (1 + excess.float() * _clipped(image_srgb).float())
        through = share.float() * image * (mask > 0)
        albedo = reference_linear.float().clamp(min=DARKEST_ALBEDO)[:, :, None, None]
        return through / albedo, image - through

    def _predict(self, image_srgb: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        height, width = image_srgb.shape[-2:]
        light = image_srgb.mean(dim=(1, 2, 3), keepdim=True).expand(-1, 1, height, width)
        x = torch.cat([image_srgb, mask, _clipped(image_srgb), light], dim=1)
        x = nn.functional.pad(x, (0, -width % 16, 0, -height % 16))
        skips = [self.detail(x)]
        for down, deep in zip(self.down, self.deep, strict=True):
            x = down(skips[-1])
            skips.append(x + deep(x))
        x = skips.pop()
        x = x + self.globe(x.mean(dim=(2, 3)))[:, :, None, None]
        for up in self.up:
            skip = skips.pop()
            x = up(torch.cat([nn.functional.interpolate(x, scale_factor=2.0), skip], dim=1))
        out = self.head(x)[..., :height, :width]
        return torch.sigmoid(out[:, :3]), nn.functional.softplus(out[:, 3:])


def _clipped(image_srgb: Tensor) -> Tensor:
    """(B, 1, H, W): 1 where the display's range ends before the light does."""
    return (image_srgb.amax(dim=1, keepdim=True) >= CLIPPED).to(image_srgb.dtype)


def _block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Convolution, group normalisation (frames are few per batch) and SiLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, padding=1), nn.GroupNorm(4, outputs), nn.SiLU(inplace=True)
    )
