"""How well a data set's frames are rendered, and how much time may be saved on them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from .schema import Fields


@dataclass(frozen=True)
class Quality:
    """Settings of the path tracer; `rauca bench dataset` measures what each costs and gives.

    Attributes:
        samples: paths per pixel of each render, before denoising; the most a pixel gets if sampling is adaptive.
        adaptive_threshold: noise at which a pixel stops being sampled; 0 gives every pixel all samples.
        denoise: use Open Image Denoise.
        bounces: of light between surfaces.
        composed_fog: compose fog around the vehicle from the clear render, where that is accurate.
    """

    samples: int = 8
    adaptive_threshold: float = 0.0
    denoise: bool = True
    bounces: int = 4
    composed_fog: bool = True

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(fields: Fields) -> Quality:
        quality = Quality(
            fields.integer("samples", 1, 65536),
            fields.number("adaptive_threshold", 0, 1),
            fields.flag("denoise"),
            fields.integer("bounces", 0, 64),
            fields.flag("composed_fog"),
        )
        fields.done()
        return quality
