"""How much is measured: everything, a quick look, or the least that still exercises every part."""

from __future__ import annotations

from dataclasses import dataclass

UV_SIZE = 2048  # texels; the published renderer's
AGREEMENT_UV_SIZE = 1024  # texels; at which the UV error against Blender is counted


@dataclass(frozen=True)
class Settings:
    """One run's extent.

    Attributes:
        sizes: of the square images, pixels.
        uv_size: of the UV map, texels.
        paper_views, close_views: cameras of each ring.
        reach_views: cameras over which the reach of gradients is counted.
        samples: subsamples per pixel and axis at which our renderer is measured.
        reference_samples: subsamples per pixel and axis of the reference.
        repeats: timings of which the median is taken.
        steps: steps of Algorithm 2 that are timed; each takes most of a second.
        cameras: random cameras per vehicle for the agreement with Blender.
        camera_size: their image size, pixels.
        mask_samples, color_samples: of Cycles per pixel, for coverage masks and for the albedo.
        color_views: cameras of the albedo comparison.
    """

    sizes: tuple[int, ...] = (320, 640)
    uv_size: int = UV_SIZE
    paper_views: int = 8
    close_views: int = 3
    reach_views: int = 32
    samples: tuple[int, ...] = (1, 2, 4, 8, 12)
    reference_samples: int = 16
    repeats: int = 15
    steps: int = 5
    cameras: int = 32
    camera_size: int = 320
    mask_samples: int = 1024
    color_samples: int = 256
    color_views: int = 2


FULL = Settings()
QUICK = Settings(
    sizes=(640,),
    paper_views=3,
    close_views=1,
    reach_views=4,
    samples=(1, 2, 4, 8),
    repeats=5,
    steps=2,
    cameras=2,
    mask_samples=256,
    color_views=1,
)
