"""From data sets to weights with a model card: the training of extractors as users start it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.seeding import named_seed
from ..environment.extractor import WIDTHS, LightSplitter, PublishedEfe
from ..environment.frames import LightFrames
from ..environment.metrics import Error, total
from ..environment.weights import ModelCard, PublishedCard, load_extractor, load_published, read_card, save_extractor
from ..runtime.devices import find_device
from ..runtime.distributed import Processes, joined_processes
from .extractor import EpochReport, Job, Outcome, train
from .extractor_learners import FinalLearner, SplitterLearner
from .fit import Given, describe
from .settings import ExtractorSettings

WEIGHTS = "light-splitter.safetensors"
PUBLISHED_WEIGHTS = "published.safetensors"
FINISHED = "finished.json"
# Channels per level by name. A quarter is a sixteenth of the work: on a CPU, hundreds of frames rather than tens.
PUBLISHED_WIDTHS = {"paper": WIDTHS, "quarter": tuple(width // 4 for width in WIDTHS)}
ALL = "all"  # weathers together, in a card's metrics


@dataclass(frozen=True, kw_only=True)
class Fit(Given):
    """An extractor's training."""

    settings: ExtractorSettings


def fit(
    wanted: Fit,
    on_epoch: Callable[[EpochReport], None] = lambda report: None,
    on_step: Callable[[int, int], None] = lambda done, steps: None,
) -> tuple[Path, Outcome]:
    """Train, or go on; the best weights on the test frames end in ``out``. Run by ``torchrun``, all processes share it.

    Raises:
        RaucaError: unusable data sets, settings, folder or weights; a loss that is not finite.
    """
    frames = LightFrames([*wanted.datasets, *wanted.tests], wanted.settings.memory_mb, wanted.settings.size)
    settings = wanted.settings
    chosen, held_out = wanted.split(frames, settings.split, settings.test_share, settings.seed)
    net, origin = _start(wanted)
    weights = wanted.out / WEIGHTS
    described = describe(frames, held_out)

    def keep(epoch: int, best: nn.Module, errors: dict[str, Error]) -> None:
        everything = {**errors, ALL: total(errors.values())}
        card = ModelCard(
            widths=net.widths,
            detail=net.detail_width,
            data=described,
            command=wanted.command,
            seed=settings.seed,
            epochs=epoch,
            settings=settings.model_dump(mode="json"),
            metrics={weather: error.to_json() for weather, error in sorted(everything.items())},
            remarks=wanted.remarks,
        )
        save_extractor(weights, best, card)

    with joined_processes(wanted.device) as processes:
        job = Job(
            SplitterLearner(net, frames, settings), frames, chosen, held_out, settings, wanted.out, keep,
            {"start": origin, "datasets": len(wanted.datasets)},
        )  # fmt: skip
        return weights, train(job, processes, on_epoch, on_step)


def _start(wanted: Fit) -> tuple[LightSplitter, str]:
    """The network to begin with, and what names it."""
    if wanted.start is None:
        torch.manual_seed(named_seed(wanted.settings.seed, "weights"))
        return LightSplitter(), "drawn"
    net, _ = load_extractor(wanted.start)
    return net, read_card(wanted.start, ModelCard)[1]


def fit_published(
    dataset: Path,
    out: Path,
    epochs: int,
    threads: int | None = None,
    on_epoch: Callable[[EpochReport], None] = lambda report: None,
    device: torch.device | str | None = "cpu",
    width: str = "quarter",
) -> Path:
    """Train the published extractor, go on, or find it finished in ``out``: its final loop, Adam 0.01, Eq. 5 with W.

    Returns the weights that did best on held-out places.

    Args:
        dataset: with light maps and at least two locations.
        epochs: at most; the paper's criterion of convergence may end it sooner.
        device: a GPU if there is one, when None.
        width: a key of :data:`PUBLISHED_WIDTHS`.

    Raises:
        RaucaError: unusable data set or folder; no such width; a loss that is not finite.
    """
    weights = out / PUBLISHED_WEIGHTS
    if width not in PUBLISHED_WIDTHS:
        raise RaucaError(f"--width: no {width!r}; choose {' or '.join(PUBLISHED_WIDTHS)}")
    widths = PUBLISHED_WIDTHS[width]
    if (out / FINISHED).is_file():
        found = load_published(weights)
        if found.widths != widths:
            raise RaucaError(f"{weights}: it has other channels than --width {width}; choose another --out")
        return weights
    settings = ExtractorSettings.make(method="published-final", batch=4, epochs=epochs, threads=threads)
    frames = LightFrames([dataset])
    chosen, held_out = frames.split(settings.split, settings.test_share, settings.seed)
    torch.manual_seed(named_seed(settings.seed, "published weights"))
    net = PublishedEfe(widths)
    data = {"name": frames.datasets[0].plan.name, "frames": len(chosen), "size": frames.size}

    def keep(epoch: int, best: nn.Module, errors: dict[str, Error]) -> None:
        error = total(errors.values()).mae
        save_extractor(weights, best, PublishedCard(widths, settings.model_dump(mode="json"), data, error))

    identity = {"widths": list(widths)}
    job = Job(FinalLearner(net, frames, settings), frames, chosen, held_out, settings, out, keep, identity)
    outcome = train(job, Processes(0, 1, find_device(device)), on_epoch)
    write_json(out / FINISHED, {"errors": outcome.errors, "best_epoch": outcome.best_epoch})
    return weights
