"""What a user may choose about training a detector or an extractor, and about hardening."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field

from ..contract.seeding import named_seed
from ..runtime.settings import Settings


class Learning(Settings):
    """What all of them share.

    Attributes:
        test_share: of every data set's locations, held out to test on.
        seed: names every random stream.
        threads: of torch on the CPU; None leaves torch's own choice.
        memory_mb: of frames, and taps, kept in memory, MiB.
    """

    test_share: float = Field(0.25, gt=0, lt=1)
    seed: int = Field(0, ge=0)
    threads: int | None = Field(None, ge=1)
    memory_mb: int = Field(2048, ge=64)

    def identity(self) -> dict[str, Any]:
        """The settings that a resumed run must share to end as one that never stopped."""
        return self.model_dump(mode="json", exclude={"threads", "memory_mb", "round", "every"})


class DetectorSettings(Learning):
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
        fewest: boxes that a class must have in the training data to be learnt; ``car`` always is.
        precision: of the network's products; bfloat16 is half as expensive on processors that have it.
        inner_step: how far an attack inside every step moves the paint of every other image, see `inner_attack`; 0
            makes none.
    """

    steps: int = Field(3000, ge=1)
    batch: int = Field(8, ge=1, le=256)
    lr: float = Field(5e-4, gt=0, le=1)
    backbone_lr: float = Field(0.3, ge=0, le=1)
    weight_decay: float = Field(1e-2, ge=0)
    clip: float = Field(5.0, gt=0)
    ema: float = Field(0.998, ge=0, lt=1)
    size: int = Field(320, ge=64, le=2048, multiple_of=64)
    round: int = Field(250, ge=1)
    fewest: int = Field(100, ge=1)
    precision: Literal["float32", "bfloat16"] = "float32"
    inner_step: float = Field(0.0, ge=0, le=1)

    def identity(self) -> dict[str, Any]:
        """As of all learning; trainings begun before there was an attack inside go on without one."""
        shared = super().identity()
        return shared if self.inner_step else {name: value for name, value in shared.items() if name != "inner_step"}


class HardenSettings(Learning):
    """Settings of :func:`harden.harden`.

    Attributes:
        rounds: of attack and fine-tuning.
        steps: of fine-tuning in each round.
        attack_steps: of the first round's optimization of a camouflage; 0 makes none.
        attack_growth: by which share of ``attack_steps`` every further round's is longer.
        attack_restarts: optimizations in each round, from other beginnings; all their camouflages join the pool.
        attack_methods: whose settings they take, see ``attack.METHODS``, one after the other and by turns.
        attack_patches: diameters in cm of the smallest patch of those of *ours*, by turns.
        attack_batch, attack_lr: of them, see ``attack.OptimizerSettings``.
        beside: camouflages for each vehicle of the pool that learn beside the detector, see :mod:`.adversary`; 0 for
            none.
        share: of frames that wear a camouflage, where one fits; the others wear plain paint, as in the first training.
        map_size, samples: of the neural renderer that composes the frames, and of the attack's.
        batch, lr, ema, precision, inner_step, every: of the fine-tuning, see ``DetectorSettings``
            (``every`` is its ``round``); ``lr`` None takes a share of the detector's own.
    """

    rounds: int = Field(1, ge=1, le=100)
    steps: int = Field(320, ge=1)
    attack_steps: int = Field(100, ge=0)
    attack_growth: float = Field(0.0, ge=0, le=10)
    attack_restarts: int = Field(1, ge=1, le=100)
    attack_methods: tuple[str, ...] = Field(("ours",), min_length=1)
    attack_patches: tuple[float, ...] = Field((5.0,), min_length=1)
    attack_batch: int = Field(4, ge=1, le=256)
    attack_lr: float = Field(0.03, gt=0, le=1)
    beside: int = Field(2, ge=0, le=16)
    share: float = Field(0.5, gt=0, lt=1)
    map_size: int = Field(1024, ge=16, le=8192)
    samples: int = Field(12, ge=1, le=16)
    batch: int = Field(8, ge=1, le=256)
    lr: float | None = Field(None, gt=0, le=1)
    ema: float = Field(0.98, ge=0, lt=1)
    precision: Literal["float32", "bfloat16"] = "float32"
    inner_step: float = Field(0.5, ge=0, le=1)
    every: int = Field(60, ge=1)

    def attack_length(self, number: int) -> int:
        """Steps of each optimization of a round, which count from 1."""
        return round(self.attack_steps * (1 + self.attack_growth * (number - 1)))

    @property
    def attack_budget(self) -> int:
        """Steps of all the hardening's attacks together."""
        return self.attack_restarts * sum(map(self.attack_length, range(1, self.rounds + 1)))

    def of_round(self, number: int, usual_lr: float) -> DetectorSettings:
        """Those of one round's fine-tuning, with random streams of its own.

        Args:
            usual_lr: the learning rate where none was chosen.
        """
        same = ("steps", "batch", "ema", "precision", "inner_step", "test_share", "threads", "memory_mb")
        chosen = {name: getattr(self, name) for name in same}
        seed = named_seed(self.seed, "hardening", number)
        return DetectorSettings(**chosen, lr=self.lr or usual_lr, round=self.every, seed=seed)


class ExtractorSettings(Learning):
    """Settings of :func:`extractor.train`.

    Attributes:
        method: our extractor, or the published one by its last, ``published-final``, training loop.
        epochs: at most.
        batch: frames per step, over all processes.
        lr: of the optimizer; Adam 0.01 as published, AdamW for ours.
        weight_decay: of AdamW.
        schedule: ``cosine`` down to 0 over ``epochs`` with a warm-up of 5 %, or ``constant``.
        clip: largest norm of the gradient; 0 leaves it alone.
        weighted: W of Eq. 5 in our loss; without it every frame counts by its vehicle's area.
        average: decay of the weights' running mean, which is what is tested and kept; 0 takes the weights themselves.
        size: frames are averaged down to, pixels; None leaves them as they are.
        crop: train on random squares of this side, pixels; 0 on whole frames.
        mixed: every other frame is shown whole, averaged down to the side of ``crop``, which must divide its own.
        augment: show our extractor the frames in other light and reference paint as well.
        split: how frames are held out to test on, see ``LightFrames.split``.
        precision: ``auto`` is bfloat16 where a GPU has it, else float32.
        stop_early: end by the paper's criterion, see `extractor`. Ours starts so near the truth that 0.003 is met
            soon: use it to adapt, not to pre-train.
        eta: of that criterion, mean absolute error in sRGB values.
    """

    method: Literal["ours", "published-final"] = "ours"
    epochs: int = Field(40, ge=1)
    batch: int = Field(4, ge=1, le=1024)
    lr: float = Field(2e-3, gt=0, le=1)
    weight_decay: float = Field(1e-4, ge=0)
    schedule: Literal["cosine", "constant"] = "cosine"
    clip: float = Field(1.0, ge=0)
    weighted: bool = True
    average: float = Field(0.99, ge=0, lt=1)
    size: int | None = Field(None, ge=16)
    crop: int = Field(0, ge=0)
    mixed: bool = False
    augment: bool = True
    split: Literal["location", "view"] = "location"
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    stop_early: bool = True
    eta: float = Field(0.003, gt=0, lt=1)

    def identity(self) -> dict[str, Any]:
        free = {"stop_early", "eta", "threads", "memory_mb"} | ({"epochs"} if self.schedule == "constant" else set())
        return self.model_dump(mode="json", exclude=free)

    @classmethod
    def make(cls, **chosen: Any) -> Self:
        """Those of ``chosen``; what is left out takes its method's default: published loops learn by Adam at 0.01."""
        given = {name: value for name, value in chosen.items() if value is not None}
        if given.get("method") == "published-final":
            adam = {"lr": 0.01, "weight_decay": 0.0, "schedule": "constant", "clip": 0.0}
            given = {**adam, "batch": 16, "average": 0.0, **given}
        return super().make(**given)
