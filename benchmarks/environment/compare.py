"""Every method on textures it never saw, against Cycles."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median

import torch

from rauca_core.environment import LightSplitter, PublishedEfe
from rauca_core.environment.frames import LightFrame, LightFrames
from rauca_core.environment.methods import (
    Render,
    exact_render,
    plain_render,
    published_render,
    splitter_render,
    transfer_render,
)
from rauca_core.environment.metrics import Error, total

from .truth import Truth, regions

Method = Callable[[int, LightFrame], Render]
Key = tuple[str, str, str, str]
"""Method, weather, texture, region."""
METHODS = ("none", "transfer", "published", "ours", "exact")


@dataclass(eq=False)
class Comparison:
    """Errors of every method.

    Attributes:
        errors: by method, weather, texture and region: ``paint``, ``inside`` or ``edge``.
        ms: by method, CPU milliseconds of the images: light maps and one texture.
    """

    errors: dict[Key, Error] = field(default_factory=dict)
    ms: dict[str, list[float]] = field(default_factory=dict)

    def find(
        self, method: str, weathers: Sequence[str] = (), texture: str | None = None, region: str = "paint"
    ) -> Error:
        """The error over weathers (all by default) and textures."""
        return total(
            error
            for (m, w, t, r), error in self.errors.items()
            if m == method and r == region and (not weathers or w in weathers) and texture in (None, t)
        )

    def median_ms(self, method: str) -> float:
        return median(self.ms[method])

    def weathers(self) -> list[str]:
        return list(dict.fromkeys(w for _, w, _, _ in self.errors))

    def methods(self) -> list[str]:
        return list(dict.fromkeys(m for m, _, _, _ in self.errors))


def methods_of(frames: LightFrames, ours: LightSplitter, published: PublishedEfe) -> dict[str, Method]:
    """What is compared, by name; plain shading is rasterized anew, as in an attack's first step on a view."""
    return {
        "none": lambda i, frame: plain_render(frame, frames.render_plain(i)),
        "transfer": lambda i, frame: transfer_render(frame),
        "published": lambda i, frame: published_render(published, frame, frames.render_plain(i)),
        "ours": lambda i, frame: splitter_render(ours, frame),
        "exact": lambda i, frame: exact_render(frame),
    }


def compare(frames: LightFrames, truths: Sequence[Truth], methods: Mapping[str, Method]) -> Comparison:
    """Light every truth's frame by every method."""
    found = Comparison()
    for truth in truths:
        frame = frames.get(truth.index)
        where = regions(frames.datasets[0], frames.places[truth.index].frame.id)
        for name, method in methods.items():
            started = time.process_time()
            with torch.no_grad():
                seen = method(truth.index, frame)(truth.albedo)[0]
            found.ms.setdefault(name, []).append(1e3 * (time.process_time() - started))
            for region, mask in where.items():
                found.errors[name, frame.weather, truth.texture, region] = truth.error(seen, mask)
    return found
