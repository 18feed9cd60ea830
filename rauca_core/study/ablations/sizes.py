"""How much an ablation renders, optimizes and measures."""

from __future__ import annotations

from dataclasses import dataclass

from ..views import RING, HeldOut


@dataclass(frozen=True)
class Sizes:
    """The extent of an ablation.

    Attributes:
        frames: of every training set; those that hide most of the paint are left out of them.
        held_out: frames to measure on, per weather set.
        weathers: sets of held-out views, ``seen`` and ``unseen``.
        steps, batch, lr, map_size: of every optimization, where a variant says nothing else.
        pixels, samples: of all frames: their side, and Cycles samples per pixel.
        detectors: to measure with; None for every one that is ready and was not trained on this project's images.
        seeds: camouflages per variant; None for the experiment's own choice.
        extractor_epochs: of the published extractor's training, where it takes part.
    """

    frames: int = 96
    held_out: int = 64
    weathers: tuple[str, ...] = ("seen", "unseen")
    steps: int = 600
    batch: int = 4
    lr: float = 0.02
    map_size: int = 1024
    pixels: int = 320
    samples: int = 8
    detectors: tuple[str, ...] | None = None
    seeds: int | None = None
    extractor_epochs: int = 20

    @property
    def views(self) -> HeldOut:
        """The held-out views."""
        return HeldOut(self.held_out, RING, size=self.pixels, samples=self.samples)


DEFAULT = Sizes()
QUICK = Sizes(
    frames=16,
    held_out=12,
    weathers=("seen",),
    steps=60,
    map_size=512,
    pixels=192,
    samples=4,
    detectors=("yolov3-tiny", "yolov4-tiny"),
    seeds=1,
    extractor_epochs=2,
)
