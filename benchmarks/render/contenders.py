"""The renderers that are compared. Each is a choice of taps, so all run through the same operator."""

from __future__ import annotations

from dataclasses import dataclass

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import Pyramid, Taps, build_taps
from rauca_core.render.sampler import Sampler

ALGORITHM_2 = "Algorithm 2, 2x2"
BILINEAR = "1 bilinear sample"


@dataclass(frozen=True)
class Contender:
    """A renderer: how it looks up texels, and how many subsamples it takes per pixel along each axis."""

    name: str
    sampler: Sampler
    samples: int

    @property
    def ours(self) -> bool:
        return self.sampler is Sampler.AREA

    def taps(self, vehicle: Vehicle, camera: Camera, pyramid: Pyramid) -> Taps:
        """Its taps with the box filter, which is the reference's."""
        return build_taps(vehicle, camera, pyramid.size, self.samples, "box", pyramid=pyramid, sampler=self.sampler)


def contenders(samples: tuple[int, ...]) -> list[Contender]:
    """Samplers of the literature, the published algorithms at their published 2x2, ours at each of ``samples``."""
    return [
        Contender(BILINEAR, Sampler.BILINEAR, 1),
        Contender("1 trilinear sample", Sampler.TRILINEAR, 1),
        Contender("Algorithm 1, 2x2", Sampler.TENSOR_TRAVERSAL, 2),
        Contender(ALGORITHM_2, Sampler.UV_TRAVERSAL, 2),
        *(Contender(ours(n), Sampler.AREA, n) for n in samples),
    ]


def rivals() -> list[Contender]:
    """The published algorithms and ours at the same 2x2."""
    published = [c for c in contenders((2,)) if c.sampler.through_facets]
    return [*published, Contender(ours(2), Sampler.AREA, 2)]


def ours(samples: int) -> str:
    """The name of our renderer with that many subsamples per axis."""
    return f"ours {samples}x{samples}"
