"""Every way to light a vehicle, behind one call: what a frame looks like in any paint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..render import linear_to_srgb, srgb_to_linear
from .estimate import split_light
from .extractor import DARKEST_ALBEDO, LightSplitter, PublishedEfe, fuse_published
from .frames import LightFrame
from .shading import PlainShading

Render = Callable[[Tensor], Tensor]
"""Linear albedo (C, 3, 1, 1) or (C, 3, H, W) -> the frame in C paints, (C, 3, H, W) sRGB, float32."""


@dataclass(frozen=True, eq=False)
class AffineRender:
    """Light maps A and B, (3, H, W) linear, as a :data:`Render`: linear_to_srgb(A * x + B)."""

    A: Tensor
    B: Tensor

    def __call__(self, albedo: Tensor) -> Tensor:
        return linear_to_srgb(self.A * albedo + self.B)

    def where(self, mask: Tensor) -> AffineRender:
        """The N pixels of a mask (H, W) alone, as an image of one row, (3, 1, N)."""
        return AffineRender(self.A[:, mask][:, None], self.B[:, mask][:, None])


def exact_render(frame: LightFrame) -> AffineRender:
    """The maps that Blender rendered: the truth of every other method, but for what is not affine."""
    return AffineRender(frame.A.float(), frame.B.float())


def transfer_render(frame: LightFrame) -> AffineRender:
    """Color transfer without training; see `affine_transfer`."""
    image = srgb_to_linear(frame.image.float() / 255)
    return AffineRender(*transfer_light(image, frame.paint.float() / 255, frame.reference))


def splitter_render(net: LightSplitter, frame: LightFrame) -> AffineRender:
    """Our extractor, one inference for all paints."""
    return AffineRender(*split_light(net, frame.image.float() / 255, frame.paint.float() / 255, frame.reference))


def plain_render(frame: LightFrame, plain: PlainShading) -> Render:
    """No environment: Neural Renderer's shading, on the frame's own background."""
    background = frame.image.float() / 255 * (1 - plain.coverage)
    return lambda albedo: plain.x_nr(linear_to_srgb(albedo)) + background


def published_render(net: PublishedEfe, frame: LightFrame, plain: PlainShading) -> Render:
    """The published extractor, one inference for all paints; the vehicle is put back on the frame's background."""
    device = next(net.parameters()).device
    image, vehicle = frame.image.float() / 255, frame.vehicle.float() / 255
    with torch.no_grad():
        A, B = (m[0].cpu() for m in net((image * vehicle)[None].to(device)))

    def render(albedo: Tensor) -> Tensor:
        # The network is taught images with a black background, so its own are dark by coverage already.
        fused = fuse_published(plain.x_nr(linear_to_srgb(albedo)), A, B) * (vehicle > 0)
        return (fused + image * (1 - vehicle)).clamp(max=1.0)

    return render


DARK, BRIGHT = 0.01, 0.95  # quantiles of the paint's light, per channel
SOLID = 0.98  # coverage from which a pixel counts as all paint


def transfer_light(image_linear: Tensor, paint: Tensor, reference_linear: Tensor) -> tuple[Tensor, Tensor]:
    """Light maps of one frame, by color transfer without training: from the image's own statistics.

    The reference image shows paint of one known albedo r, so I = A * r + B per pixel and channel. Two assumptions over
    the paint of one frame split it:

    * what the darkest paint sends, the first percentile, reaches every pixel without touching the paint's color: fog
      glow and the coat's dim reflections. That is B.
    * nothing diffuse is brighter than the paint's 95th percentile: light beyond is a mirror image, and goes to B too.

    Then A = (min(I, bright) - dark) / r and B = I - A * r: a per-pixel affine color transfer, which gives the reference
    back.

    Args:
        image_linear: (3, H, W) linear frame in the reference paint.
        paint: (1, H, W) coverage of the paint.
        reference_linear: (3,) albedo of the reference paint.

    Returns:
        A and B, (3, H, W) linear; without paint A is 0 and B the image.
    """
    solid = paint[0] >= SOLID if (paint >= SOLID).any() else paint[0] > 0
    if not solid.any():
        return torch.zeros_like(image_linear), image_linear
    seen = image_linear[:, solid]
    dark, bright = (torch.quantile(seen, q, dim=1)[:, None, None] for q in (DARK, BRIGHT))
    through = (torch.minimum(image_linear, bright) - dark * paint).clamp(min=0.0) * (paint > 0)
    albedo = reference_linear.to(image_linear).clamp(min=DARKEST_ALBEDO)[:, None, None]
    A = through / albedo
    return A, image_linear - A * reference_linear.to(image_linear)[:, None, None]
