"""Every way to light a vehicle, behind one call: what a frame looks like in any paint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..render import linear_to_srgb, srgb_to_linear
from .affine_transfer import transfer_light
from .extractor import LightSplitter
from .focus import split_light
from .frames import LightFrame
from .published import PublishedEfe, fuse_published
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
