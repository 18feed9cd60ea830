"""What a user may choose about the training of a detector."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

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


def make_detector_settings(**chosen: Any) -> DetectorSettings:
    """Check settings from a command line, None meaning the default; raises :class:`RaucaError` naming a bad one."""
    return checked(DetectorSettings, {name: value for name, value in chosen.items() if value is not None})
