"""How much is measured: everything, a quick look, or the least that still exercises every part."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

KINDS = ("clear", "foggy", "night")


@dataclass(frozen=True)
class Settings:
    """One run's extent.

    Attributes:
        size: of the square frames, pixels.
        views: of the default ring, on which errors are measured: near and low, far and high.
        reference_samples: per pixel of each of the reference's two halves.
        single_samples: per pixel, of denoised renders of one color.
        raw_samples: the same without the denoiser, for renders and light maps alike.
        map_samples: per pixel, of denoised light maps.
        thresholds: of adaptive sampling, with at most ``adaptive_samples``.
        bounces: other numbers of them.
        fog_densities: of the curve of composed fog, by day and by night.
        fog_samples: per pixel of each half of the curve's references.
        sets: weather presets rendered whole, each with the views it is rendered on.
    """

    size: int = 320
    views: tuple[int, ...] = (1, 26)
    reference_samples: int = 80
    single_samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    raw_samples: tuple[int, ...] = (8,)
    map_samples: tuple[int, ...] = (2, 4, 8, 16)
    thresholds: tuple[float, ...] = (0.02, 0.05, 0.1)
    adaptive_samples: int = 64
    bounces: tuple[int, ...] = (1, 2, 12)
    fog_densities: tuple[float, ...] = (25.0, 50.0, 75.0, 90.0)
    fog_samples: int = 32
    sets: tuple[tuple[str, tuple[int, ...]], ...] = (("base", (1, 26)), ("enhanced", (26,)))

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> Settings:
        """Undo :meth:`to_json` after JSON made lists of tuples."""
        whole: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in values.items()
        }
        whole["sets"] = tuple((name, tuple(views)) for name, views in values["sets"])
        return Settings(**whole)


FULL = Settings()
QUICK = Settings(
    views=(26,),
    reference_samples=16,
    single_samples=(2, 4, 8, 16),
    raw_samples=(8,),
    map_samples=(4, 8),
    thresholds=(0.05,),
    bounces=(1,),
    fog_densities=(50.0,),
    fog_samples=12,
    sets=(("base", (26,)),),
)
