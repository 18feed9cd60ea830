"""What a user may choose about the training of an extractor, and when it has converged.

The paper's criterion (its Section IV, on pre-trained extractors): S_i is the mean absolute error on the test set after
epoch i, ``MS_i = gamma * S_{i-1} + (1 - gamma) * S_i`` smooths it, and epoch i is converged if "the difference between
the loss over the previous five epochs and that at epoch i is within" eta. We read: ``|MS_j - MS_i| <= eta`` for every j
of the five epochs before i. Epoch 0 is the start, before any step; MS_0 = S_0. The first epoch that can pass is thus
the fifth, which is the smallest figure the paper reports.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ..runtime.settings import checked

ETA, WINDOW, GAMMA = 0.003, 5, 0.5


def smoothed(errors: Sequence[float], gamma: float = GAMMA) -> list[float]:
    """MS_i of S_i, i from 0."""
    return [s if i == 0 else gamma * errors[i - 1] + (1 - gamma) * s for i, s in enumerate(errors)]


def converged_epoch(
    errors: Sequence[float], eta: float = ETA, window: int = WINDOW, gamma: float = GAMMA
) -> int | None:
    """The first converged epoch of test errors S_0, S_1, ... (mean absolute, sRGB values in [0, 1]), or None."""
    smooth = smoothed(errors, gamma)
    for i in range(window, len(smooth)):
        if all(abs(before - smooth[i]) <= eta for before in smooth[i - window : i]):
            return i
    return None


class TrainingSettings(BaseModel):
    """Settings of :func:`training.train`.

    Attributes:
        method: our extractor; or the published one by its first, ``published-base``, or its last, ``published-final``,
            training loop.
        epochs: at most.
        batch: frames per step, over all processes.
        lr: of the optimizer; Adam 0.01 as published, AdamW for ours.
        weight_decay: of AdamW.
        schedule: ``cosine`` down to 0 over ``epochs`` with a warm-up of 5 %, or ``constant``.
        clip: largest norm of the gradient; 0 leaves it alone.
        loss: of the published extractor: ``bce``, Eq. 5, or ``mse``, the published code's.
        weighted: W of Eq. 5; without it every frame counts by its vehicle's area.
        colors: albedos that one inference of ours is compared in.
        average: decay of the weights' running mean, which is what is tested and kept; 0 takes the weights themselves.
        size: frames are averaged down to, pixels; None leaves them as they are.
        crop: train on random squares of this side, pixels; 0 on whole frames.
        mixed: every other frame is shown whole, averaged down to the side of ``crop``, which must divide its own.
        augment: show our extractor the frames in other light and reference paint as well.
        split, test_share: how frames are held out to test on, see ``LightFrames.split``.
        precision: ``auto`` is bfloat16 where a GPU has it, else float32.
        stop_early: end by the paper's criterion, see `convergence`. Ours starts so near the truth that 0.003 is met
            soon: use it to adapt, not to pre-train.
        eta: of that criterion, mean absolute error in sRGB values.
        seed: names every random stream.
        threads: of torch on the CPU; None leaves torch's own choice.
        memory_mb: of frames kept in memory, MiB.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    method: Literal["ours", "published-base", "published-final"] = "ours"
    epochs: int = Field(40, ge=1)
    batch: int = Field(4, ge=1, le=1024)
    lr: float = Field(2e-3, gt=0, le=1)
    weight_decay: float = Field(1e-4, ge=0)
    schedule: Literal["cosine", "constant"] = "cosine"
    clip: float = Field(1.0, ge=0)
    loss: Literal["bce", "mse"] = "bce"
    weighted: bool = True
    colors: int = Field(6, ge=1, le=64)
    average: float = Field(0.99, ge=0, lt=1)
    size: int | None = Field(None, ge=16)
    crop: int = Field(0, ge=0)
    mixed: bool = False
    augment: bool = True
    split: Literal["location", "view"] = "location"
    test_share: float = Field(0.25, gt=0, lt=1)
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    stop_early: bool = True
    eta: float = Field(ETA, gt=0, lt=1)
    seed: int = Field(0, ge=0)
    threads: int | None = Field(None, ge=1)
    memory_mb: int = Field(2048, ge=64)

    def identity(self) -> dict[str, Any]:
        """The settings that a resumed run must share to end as one that never stopped."""
        free = {"stop_early", "eta", "threads", "memory_mb"} | ({"epochs"} if self.schedule == "constant" else set())
        return self.model_dump(mode="json", exclude=free)


def make_training_settings(**chosen: Any) -> TrainingSettings:
    """Check settings from a command line; raises :class:`RaucaError` naming the first bad one.

    Those left out, or None, take the default of their method: the published loops learn by plain Adam at 0.01.
    """
    given = {name: value for name, value in chosen.items() if value is not None}
    if str(given.get("method", "ours")).startswith("published"):
        given = {
            "lr": 0.01,
            "weight_decay": 0.0,
            "schedule": "constant",
            "clip": 0.0,
            "batch": 16,
            "average": 0.0,
        } | given
    return checked(TrainingSettings, given)
