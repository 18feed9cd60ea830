"""What a user may choose about training a detector, and about hardening one."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ..contract.seeding import named_seed
from ..runtime.settings import checked


class DetectorSettings(BaseModel):
    """Settings of :func:`loop.train`.

    Attributes:
        steps: of the optimizer.
        batch: images per step.
        lr: AdamW's learning rate; it rises over the first 5 % of the steps and falls to 0 on a half cosine.
        backbone_lr: that of the pre-trained backbone, as a fraction of ``lr``.
        weight_decay: of AdamW.
        clip: largest norm of the gradient.
        ema: decay per step of the moving average of the weights, which is what is tested and kept.
        size: side of the network's square input, pixels.
        round: steps between tests and checkpoints.
        test_share: without data sets to test on, the share of every data set's locations that is held out.
        fewest: boxes that a class must have in the training data to be learnt; ``car`` always is.
        precision: of the network's products; bfloat16 is half as expensive on processors that have it.
        seed: names every random stream.
        threads: of torch; None leaves torch's own choice.
        memory_mb: of frames kept in memory, MiB.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    steps: int = Field(3000, ge=1)
    batch: int = Field(8, ge=1, le=256)
    lr: float = Field(5e-4, gt=0, le=1)
    backbone_lr: float = Field(0.3, ge=0, le=1)
    weight_decay: float = Field(1e-2, ge=0)
    clip: float = Field(5.0, gt=0)
    ema: float = Field(0.998, ge=0, lt=1)
    size: int = Field(320, ge=64, le=2048, multiple_of=64)
    round: int = Field(250, ge=1)
    test_share: float = Field(0.25, gt=0, lt=1)
    fewest: int = Field(100, ge=1)
    precision: Literal["float32", "bfloat16"] = "float32"
    seed: int = Field(0, ge=0)
    threads: int | None = Field(None, ge=1)
    memory_mb: int = Field(2048, ge=64)

    def identity(self) -> dict[str, Any]:
        """The settings that a resumed run must share to end as one that never stopped."""
        return self.model_dump(mode="json", exclude={"threads", "memory_mb", "round"})


class HardenSettings(BaseModel):
    """Settings of :func:`harden.harden`.

    Attributes:
        rounds: of attack and fine-tuning.
        steps: of fine-tuning in each round.
        attack_steps: of the optimization that makes each round's camouflage; 0 makes none.
        attack_batch, attack_lr: of it, see ``attack.OptimizerSettings``.
        share: of frames that wear a camouflage, where one fits; the others wear plain paint, as in the first training.
        map_size, samples: of the neural renderer that composes the frames, and of the attack's.
        batch, lr, ema, precision, every: of the fine-tuning, see ``DetectorSettings``
            (``every`` is its ``round``); ``lr`` None takes a share of the detector's own.
        test_share: of every data set's locations, or views where one has a single location, held out to watch the
            fine-tuning.
        seed: names every random stream.
        threads, memory_mb: of torch, and of frames and taps kept in memory.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    rounds: int = Field(3, ge=1, le=100)
    steps: int = Field(120, ge=1)
    attack_steps: int = Field(100, ge=0)
    attack_batch: int = Field(4, ge=1, le=256)
    attack_lr: float = Field(0.03, gt=0, le=1)
    share: float = Field(0.5, gt=0, lt=1)
    map_size: int = Field(1024, ge=16, le=8192)
    samples: int = Field(12, ge=1, le=16)
    batch: int = Field(8, ge=1, le=256)
    lr: float | None = Field(None, gt=0, le=1)
    ema: float = Field(0.98, ge=0, lt=1)
    precision: Literal["float32", "bfloat16"] = "float32"
    every: int = Field(60, ge=1)
    test_share: float = Field(0.25, gt=0, lt=1)
    seed: int = Field(0, ge=0)
    threads: int | None = Field(None, ge=1)
    memory_mb: int = Field(2048, ge=64)

    def identity(self) -> dict[str, Any]:
        """The settings that a resumed run must share to end as one that never stopped."""
        return self.model_dump(mode="json", exclude={"threads", "memory_mb", "every"})

    def of_round(self, number: int, usual_lr: float) -> DetectorSettings:
        """Those of one round's fine-tuning, with random streams of its own.

        Args:
            usual_lr: the learning rate where none was chosen.
        """
        same = ("steps", "batch", "ema", "precision", "test_share", "threads", "memory_mb")
        chosen = {name: getattr(self, name) for name in same}
        seed = named_seed(self.seed, "hardening", number)
        return DetectorSettings(**chosen, lr=self.lr or usual_lr, round=self.every, seed=seed)


def make_detector_settings(**chosen: Any) -> DetectorSettings:
    """Check settings from a command line, None meaning the default; raises :class:`RaucaError` naming a bad one."""
    return checked(DetectorSettings, {name: value for name, value in chosen.items() if value is not None})


def make_harden_settings(**chosen: Any) -> HardenSettings:
    """The same for a hardening."""
    return checked(HardenSettings, {name: value for name, value in chosen.items() if value is not None})
