"""From a data set to weights of the published extractor: its final training loop, Adam 0.01, Eq. 5 with W."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch

from ..contract.files import write_json
from ..contract.seeding import named_seed
from ..runtime.checkpoint_files import POINTER
from ..runtime.distributed import SINGLE_PROCESS
from .frames import LightFrames
from .metrics import Error, total
from .published import PublishedEfe
from .published_training import FinalLearner
from .published_weights import PublishedCard, load_published, save_published
from .settings import make_training_settings
from .training import CHECKPOINTS, EpochReport, Job, train

WEIGHTS = "published.safetensors"
FINISHED = "finished.json"
# A quarter of the published channels, a sixteenth of the work: on a CPU, hundreds of frames rather than tens.
NARROW = (16, 32, 64, 128, 256)


def fit_published(
    dataset: Path,
    out: Path,
    epochs: int,
    widths: tuple[int, ...] = NARROW,
    seed: int = 0,
    threads: int | None = None,
    on_epoch: Callable[[EpochReport], None] = lambda report: None,
) -> Path:
    """Train, go on, or find finished in ``out``; returns the weights that did best on held-out places.

    Args:
        dataset: with light maps and at least two locations.
        epochs: at most; the paper's criterion of convergence may end it sooner.

    Raises:
        RaucaError: unusable data set or folder; a loss that is not finite.
    """
    weights = out / WEIGHTS
    if (out / FINISHED).is_file():
        load_published(weights)
        return weights
    settings = make_training_settings(method="published-final", batch=4, epochs=epochs, seed=seed, threads=threads)
    frames = LightFrames([dataset])
    chosen, held_out = frames.split(settings.split, settings.test_share, seed)
    torch.manual_seed(named_seed(seed, "published weights"))
    net = PublishedEfe(widths)
    data = {"name": frames.datasets[0].plan.name, "frames": len(chosen), "size": frames.size}

    def keep(epoch: int, errors: dict[str, Error]) -> None:
        error = total(errors.values()).mae
        save_published(weights, net, PublishedCard(widths, data, settings.model_dump(mode="json"), error))

    job = Job(FinalLearner(net, frames, settings), frames, chosen, held_out, settings, out, keep)
    outcome = train(job, SINGLE_PROCESS, (out / CHECKPOINTS / POINTER).is_file(), on_epoch)
    write_json(out / FINISHED, {"errors": outcome.errors, "best_epoch": outcome.best_epoch})
    return weights
