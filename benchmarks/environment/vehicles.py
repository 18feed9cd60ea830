"""Unseen vehicles: epochs to converge from scratch and from pre-trained weights, and the error after fine-tuning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rauca_core.contract.color import TEST
from rauca_core.environment import LightSplitter, load_extractor
from rauca_core.environment.convergence import smoothed
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import splitter_render
from rauca_core.environment.metrics import measure, total

from .datasets import make, vehicle_data
from .settings import Settings
from .trainings import Trained, drawn, train_ours

RATE: dict[str, Any] = {"lr": 1e-3, "schedule": "constant", "crop": 80, "mixed": False}
NEAR = 1.05  # times the least error from scratch


@dataclass(frozen=True)
class Adapted:
    """One unseen vehicle.

    Attributes:
        epochs_scratch, epochs_pretrained: to the paper's criterion; the most that were tried if it was not met. Ours
            starts so near the truth that its 0.003 is soon met, from scratch as well: the others say more.
        near_scratch, near_pretrained: to an error within 5 % of the least from scratch; None if never.
        epochs_matched: from scratch, until the error that pre-trained weights had when they converged; None if never.
        mae_scratch, mae_pretrained: least mean absolute test errors.
        before_db, after_db: on unseen weather, by the pre-trained weights as they are, and fine-tuned.
    """

    vehicle: str
    epochs_scratch: int
    epochs_pretrained: int
    near_scratch: int | None
    near_pretrained: int | None
    epochs_matched: int | None
    mae_scratch: float
    mae_pretrained: float
    before_db: float
    after_db: float

    def to_json(self) -> dict[str, Any]:
        return {k: round(v, 4) if isinstance(v, float) else v for k, v in vars(self).items()}


def adapt(vehicle: str, settings: Settings, folder: Path, weights: Path | None = None) -> Adapted:
    """Train twice on one vehicle, by the same settings."""
    seen, unseen = vehicle_data(vehicle, settings)
    frames, other = (LightFrames([make(wanted, folder).folder]) for wanted in (seen, unseen))
    train_on, test_on = frames.split("location", 1 / settings.vehicle_locations)
    pretrained, _ = load_extractor(weights)
    before = _unseen_db(pretrained, other)

    def run(net: LightSplitter, how: str) -> Trained:
        chosen = RATE | {"epochs": settings.most_epochs}
        return train_ours(frames, train_on, test_on, net, f"{vehicle} {how}", **chosen)

    scratch, tuned = run(drawn(), "from scratch"), run(pretrained, "pre-trained")
    assert isinstance(tuned.net, LightSplitter)
    errors, better = scratch.outcome.errors, tuned.outcome.errors
    converged = tuned.outcome.converged or settings.most_epochs
    return Adapted(
        vehicle,
        scratch.outcome.converged or settings.most_epochs,
        converged,
        first_within(errors, NEAR * min(errors)),
        first_within(better, NEAR * min(errors)),
        first_within(smoothed(errors), smoothed(better)[converged]),
        min(errors),
        min(better),
        before,
        _unseen_db(tuned.net, other),
    )


def first_within(errors: Sequence[float], most: float) -> int | None:
    """The first epoch whose error is at most ``most``."""
    return next((epoch for epoch, error in enumerate(errors) if error <= most), None)


def _unseen_db(net: LightSplitter, frames: LightFrames) -> float:
    """PSNR in 32 colors against exact maps."""
    found = measure(frames, range(len(frames)), lambda i, frame: splitter_render(net, frame), TEST)
    return total(found.values()).psnr_db
