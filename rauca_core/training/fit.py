"""From data sets to a network with a card: what all trainings are given, and a detector's as users start it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from ..contract import RaucaError
from ..contract.files import file_digest
from ..detect.synth.card import DetectorCard, SynthDetector, load_network, save_weights
from ..detect.synth.networks import BACKBONE, build_network, find_recipe
from ..detect.weights import fetch
from ..environment.frames import LightFrames, SplitBy
from ..runtime.cpu_time import counted_in
from ..runtime.devices import find_device
from ..runtime.tensor_files import started
from .detector import Job, OnRound, OnStep, train
from .measure import CAR, Findings, Score, measure
from .samples import Samples
from .settings import DetectorSettings


@dataclass(frozen=True, kw_only=True)
class Given:
    """What any training is given.

    Attributes:
        datasets: folders to train on, with light maps and of one image size.
        out: folder for the weights and checkpoints.
        tests: folders to test on; without any, a share of the frames of ``datasets`` is held out.
        start: weights of an earlier training of the same network to begin with.
        command, remarks: for the card.
        device: that learns and tests; a GPU if there is one when None.
    """

    datasets: Sequence[Path]
    out: Path
    tests: Sequence[Path] = ()
    start: Path | None = None
    command: str = ""
    remarks: str = ""
    device: torch.device | str | None = None

    def split(self, frames: LightFrames, by: SplitBy, share: float, seed: int) -> tuple[list[int], list[int]]:
        """Indices to train on and to test on, of the frames of ``datasets`` and ``tests``.

        Raises:
            RaucaError: composed frames to test on; as of :meth:`LightFrames.split`.
        """
        if not self.tests:
            return frames.split(by, share, seed)
        for dataset in frames.datasets[len(self.datasets) :]:
            dataset.require_rendered("trainings are tested on")
        first = next(i for i, place in enumerate(frames.places) if place.dataset >= len(self.datasets))
        held_out = list(range(first, len(frames)))
        return frames.to_train_beside(held_out, range(first)), held_out


def describe(frames: LightFrames, held_out: Sequence[int]) -> list[dict[str, Any]]:
    """The data sets, for a card."""
    whole, tested = (Counter(frames.places[i].dataset for i in part) for part in (range(len(frames)), held_out))
    return [
        {
            "name": plan.name,
            "vehicle": plan.vehicle_name,
            "frames": whole[number],
            **({} if frames.has_rendered(number) else {"composed": True}),
            "tested on": tested[number],
            "size": plan.size,
            "samples": plan.quality.samples,
            "weathers": [weather.name for weather in plan.weathers],
            "seed": plan.seed,
        }
        for number, plan in enumerate(dataset.plan for dataset in frames.datasets)
    ]


@dataclass(frozen=True, kw_only=True)
class Fit(Given):
    """A detector's training.

    Attributes:
        name: of the detector, a key of ``networks.RECIPES``.
        classes: to tell apart, beside ``car``, each in the data unless ``start`` knows it; without any, those with
            ``settings.fewest`` boxes in the data.
    """

    name: str
    settings: DetectorSettings
    score: Score
    classes: Sequence[str] = ()


def fit(
    wanted: Fit,
    on_round: OnRound = lambda report: None,
    on_step: OnStep = lambda done, steps, loss: None,
) -> tuple[Path, Findings]:
    """Train, or go on; the averaged weights of the last step end in ``out`` as ``NAME.safetensors`` with their card.

    Raises:
        RaucaError: unusable data sets, settings, folder or weights; a loss that is not finite; a stop.
    """
    find_recipe(wanted.name)
    device = find_device(wanted.device)
    _check_folders(wanted)
    settings = wanted.settings
    frames = LightFrames([*wanted.datasets, *wanted.tests], settings.memory_mb)
    chosen, held_out = _split(frames, wanted)
    class_names = _class_names(frames, chosen, wanted)
    network, origin = _start(wanted, class_names)
    samples = Samples(frames, class_names, settings.size)

    def test(average: nn.Module) -> Findings:
        detector = SynthDetector(wanted.name, average, class_names, settings.size)
        return measure(detector, samples, held_out, wanted.score, settings.seed, device)

    identity = {
        "name": wanted.name, "classes": list(class_names), "data": frames.digest, "datasets": len(wanted.datasets),
        "start": origin,
    }  # fmt: skip
    job = Job(network, samples, chosen, test, settings, wanted.out, identity, device=device)
    with counted_in(wanted.out, fresh=not started(wanted.out)) as spent:
        average, findings = train(job, on_round, on_step)
    weights = wanted.out / f"{wanted.name}.safetensors"
    card = DetectorCard(
        name=wanted.name,
        class_names=class_names,
        size=settings.size,
        architecture=find_recipe(wanted.name).architecture,
        backbone=origin,
        data=describe(frames, held_out),
        command=wanted.command,
        seed=settings.seed,
        steps=settings.steps,
        settings=settings.model_dump(mode="json"),
        cpu_minutes=round(spent(), 1),
        metrics=findings.to_json(),
        remarks=wanted.remarks,
    )
    save_weights(weights, average, card)
    return weights, findings


def _check_folders(wanted: Fit) -> None:
    """Refuse what would be tested on what it was trained on."""
    for folder, times in Counter(folder.resolve() for folder in (*wanted.datasets, *wanted.tests)).items():
        if times > 1:
            raise RaucaError(f"{folder}: given more than once; what is trained on cannot be tested on")


def _split(frames: LightFrames, wanted: Fit) -> tuple[list[int], list[int]]:
    """Indices to train on and to test on; refuses what teaches or tests nothing."""
    chosen, held_out = wanted.split(frames, "location", wanted.settings.test_share, wanted.settings.seed)
    for what, indices in (("train", chosen), ("test", held_out)):
        if not any(frames.vehicle(i).category == CAR for i in indices):
            raise RaucaError(f"data sets: no frame to {what} on shows a car; add a data set of one, e.g. of the sedan")
    return chosen, held_out


def _class_names(frames: LightFrames, chosen: Sequence[int], wanted: Fit) -> tuple[str, ...]:
    """``car``, then the classes asked for, or those annotated often enough by name.

    A class that no frame shows can be kept from the weights to begin with, but not be learnt.
    """
    count: Counter[str] = Counter()
    for index in chosen:
        count[frames.vehicle(index).category] += 1
        count.update(instance.category for instance in frames.places[index].frame.instances)
    if not wanted.classes:
        usual = (name for name, boxes in count.items() if boxes >= wanted.settings.fewest)
        return (CAR, *sorted(name for name in usual if name not in (CAR, "shape")))
    unseen = [name for name in wanted.classes if name not in count]
    if unseen and wanted.start is None:
        raise RaucaError(f"--classes {unseen[0]}: in no frame to train on; choose among {', '.join(sorted(count))}")
    return tuple(dict.fromkeys((CAR, *wanted.classes)))


def _start(wanted: Fit, class_names: tuple[str, ...]) -> tuple[nn.Module, str]:
    """The network to begin with, and the sha256 of the weights that went into it."""
    if wanted.start is None:
        backbone = fetch(BACKBONE)
        return build_network(wanted.name, len(class_names), backbone, wanted.settings.seed), file_digest(backbone)
    network, card, digest = load_network(wanted.start)
    if (card.name, card.class_names) != (wanted.name, class_names):
        raise RaucaError(
            f"{wanted.start}: holds a {card.name} of the classes {', '.join(card.class_names)}, but a {wanted.name} of "
            f"{', '.join(class_names)} is to be trained; start without it"
        )
    return network, digest
