"""What a user may choose about an optimization."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from ..contract import load_camouflage
from ..contract.files import file_digest
from ..render import Sampler
from ..render.sampler import TEXTURE_SIZE
from ..runtime.settings import Settings
from .augmentation import AugmentationName
from .lights import LightName
from .losses import ObjectiveName
from .naturalness import Naturalness

Fidelity = Literal["adapted", "published"]
# Settings that came later: left out of a run's identity where they say what was done before there were any.
LATER: Mapping[str, Any] = {
    "views": "rendered",
    "fidelity": "adapted",
    "turns": False,
    "window": 1,
    "window_temperature": 0.5,
}


class OptimizerSettings(Settings):
    """Settings of :func:`optimizer.optimize`; the defaults are the paper's where it names one.

    Attributes:
        steps: gradient steps in all.
        batch: frames per step.
        lr: Adam's learning rate, on sRGB values in [0, 1].
        decay: the last step's learning rate as a share of the first, along half a cosine; 1 keeps it, as published.
        alpha, beta: weights of the attack and smoothness losses, Eq. 8.
        map_size: side of the UV map, texels.
        samples: subsamples per pixel along each axis of the renderer; against Cycles' paint coverage at 320 px, IoU is
            0.993 with 4, 0.998 with 8, 0.9993 with 12, where Cycles' own noise begins (1024 samples against 4096).
        pixel_filter: of the renderer that made the frames.
        sampler: how a subsample reads the UV map, see ``render.Sampler``: ours, or one of the literature.
        views: what a step sees: ``rendered`` frames, or ``dense``: new cameras in their places, see `drawn_frames`.
        light: where the light comes from, see `lights`.
        extractor: weights of ``light`` "ours"; the shipped ones when None.
        seed: names every random stream.
        start: ``random`` uniform texels, ``plain`` mid grey, or the ``seed`` picture of ``cover`` "panels"; with
            ``limit`` "tanh" also what it is taken of: ``tanh-unit``, uniform in [0, 1] (FCA's code), or ``tanh-wide``,
            in [-3, 3] (RAUCA-base's).
        begin_with: a camouflage (JSON or PNG) of the same vehicle to begin with, in place of ``start``.
        limit: how texels are kept in [0, 1], see `texture`: ``project``, ``clamp`` (as published) or ``tanh``.
        roa: random output augmentation.
        rest: epochs that a frame is left out for once the detectors do not see the vehicle in it, see `frame_order`.
        window: frames of a clip that follow each other and come into a step together, see `windows`; 1 takes frames
            alone.
        window_temperature: of the softmax over a window's losses, in units of the loss: the lower, the more the most
            visible frame counts.
        weights: of the detectors in the attack loss; equal when None.
        turns: a step attacks one detector, the next step the next: several cost no more than one. Else every step
            attacks all.
        precision: of the detectors' networks; losses are in float32.
        target: the class to hide.
        detector_size: images are resized to this side first, pixels, and so is the detector's input, where it is free;
            None leaves them to the detector's adapter.
        checkpoint_every: steps.
        threads: of torch on the CPU; None leaves torch's own choice.
        memory_mb: frames and taps kept in memory, MiB.
        tap_folder: where taps are cached; beside the frames when None.
        name: of the camouflage, in tables.
        method: whose settings these are, in tables, see `methods`; the fields below are what methods differ in.
        fidelity: which of the method's two forms these began with.
        paint: what is painted, see `layout`: free ``texels`` of the UV map, ``facets``, or a repeated ``pattern``.
        texture_size: ts of the facet texture tensor.
        pattern_side, tile_m: of the pattern, texels and metres.
        shift: the pattern is moved by up to this share of a tile each way, drawn at every step.
        cover: ``all`` of the paint, or ``panels``: bonnet, roof and doors, on facets.
        objective: what is made small on the detectors, see `losses`.
        smooth: where Eq. 7 is taken: on the UV ``map``, the rendered ``picture`` or the ``pattern``; or on the map
            before ``limit`` "clamp" has clipped it: ``unclamped``, as in RAUCA-final's code.
        prior, gamma: a second loss on the paint and its weight, see `paint_losses`.
        palette: dominant colors of the background in ``prior`` "background".
        augmentation: whose ranges ``roa`` draws from, see `augmentation`.
        natural: what the paint has to look like, see `naturalness`; None leaves it free.
    """

    steps: int = Field(3000, ge=1)
    batch: int = Field(4, ge=1, le=1024)
    lr: float = Field(0.01, gt=0, le=1)
    decay: float = Field(1.0, ge=0, le=1)
    alpha: float = Field(1.0, ge=0)
    beta: float = Field(0.01, ge=0)
    map_size: int = Field(1024, ge=16, le=8192)
    samples: int = Field(12, ge=1, le=16)
    pixel_filter: Literal["blackman-harris", "box"] = "blackman-harris"
    sampler: Sampler = Sampler.AREA
    views: Literal["rendered", "dense"] = "rendered"
    light: LightName = "exact"
    extractor: Path | None = None
    seed: int = Field(0, ge=0)
    start: Literal["random", "plain", "seed", "tanh-unit", "tanh-wide"] = "random"
    begin_with: Path | None = None
    limit: Literal["project", "clamp", "tanh"] = "project"
    roa: bool = True
    rest: int = Field(0, ge=0, le=1000)
    window: int = Field(1, ge=1, le=1024)
    window_temperature: float = Field(0.5, gt=0, le=1e6)
    weights: tuple[float, ...] | None = None
    turns: bool = False
    precision: Literal["float32", "bfloat16"] = "float32"
    target: str = "car"
    detector_size: int | None = Field(None, ge=32, le=8192)
    checkpoint_every: int = Field(100, ge=1)
    threads: int | None = Field(None, ge=1)
    memory_mb: int = Field(4096, ge=64)
    tap_folder: Path | None = None
    name: str = "rauca"
    method: str = "rauca"
    fidelity: Fidelity = "adapted"
    paint: Literal["texels", "facets", "pattern"] = "texels"
    texture_size: int = Field(TEXTURE_SIZE, ge=2, le=16)
    pattern_side: int = Field(64, ge=2, le=1024)
    tile_m: float = Field(1.0, gt=0, le=100)
    shift: float = Field(0.0, ge=0, le=0.5)
    cover: Literal["all", "panels"] = "all"
    objective: ObjectiveName = "eq6"
    smooth: Literal["map", "picture", "pattern", "unclamped"] = "map"
    prior: Literal["none", "background", "seed", "reference"] = "none"
    gamma: float = Field(0.0, ge=0)
    palette: int = Field(4, ge=1, le=64)
    augmentation: AugmentationName = "rauca"
    natural: Naturalness | None = None

    def identity(self) -> dict[str, Any]:
        """The settings that a resumed run must share with the run that it goes on from.

        Not the number of steps, which whoever goes on may change: the learning rate then falls toward the new last one.
        Of a reference picture only the file's name: its contents have a digest, and where it lies changes nothing. Of
        a camouflage to begin with, the digest of its UV map.
        """
        free = {"steps", "checkpoint_every", "threads", "memory_mb", "tap_folder", "name"}
        shared = self.model_dump(mode="json", exclude=free)
        if self.natural is not None and self.natural.reference is not None:
            shared["natural"]["reference"] = Path(self.natural.reference).name
        if self.natural is not None and not self.natural.symmetric:
            del shared["natural"]["symmetric"]
        for name, before in LATER.items():  # runs begun before there were others go on
            if shared[name] == before:
                del shared[name]
        if self.begin_with is None:
            del shared["begin_with"]
        else:
            shared["begin_with"] = file_digest(load_camouflage(self.begin_with)[1])
        return shared

    def lr_at(self, step: int) -> float:
        """Adam's learning rate for a step, counted from 0."""
        fallen = (1.0 - math.cos(math.pi * step / self.steps)) / 2
        return self.lr * (1.0 - (1.0 - self.decay) * fallen)


make_settings = OptimizerSettings.make
