"""How much is measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """One run's extent.

    Attributes:
        size: of the frames, pixels; the default of ``rauca dataset make``.
        detector, detector_size: the white box, and its square input.
        map_size: of the UV map, texels.
        batch: frames per step.
        views: cameras of the data set, each in ``weathers`` weathers.
        weathers: names in the preset ``base``.
        warm_up, rounds, steps: of every contender, uncounted; then ``rounds`` times ``steps`` steps, contender by
            contender.
    """

    size: int = 320
    detector: str = "yolov3-tiny"
    detector_size: int = 416
    map_size: int = 1024
    batch: int = 4
    views: int = 6
    weathers: tuple[str, ...] = ("sun90-fog0", "sun30-fog50")
    warm_up: int = 6
    rounds: int = 5
    steps: int = 12


FULL = Settings()
QUICK = Settings(views=2, weathers=("sun90-fog0",), warm_up=2, rounds=2, steps=4)
