"""Hardening: a detector is attacked, learns to see through the camouflage, and is attacked again.

Each round optimizes fresh camouflages against the detector as it is, adds them to those known, and fine-tunes on frames
of which a share wears one of them (adversarial training; Madry et al., 2018, with a pool as in Tramer et al., 2018).
The rest stays as in the first training, so that what the detector knew is not forgotten.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from ..contract import RaucaError, load_camouflage
from ..contract.files import file_digest, write_json
from ..contract.schema import read_json
from ..detect.interface import Detector
from ..detect.synth.card import HARDENED, DetectorCard, read_any_card
from ..environment.frames import LightFrames, SplitBy
from ..render import TapSettings
from ..runtime.cpu_time import counted_in
from ..runtime.devices import find_device
from ..runtime.folder_lock import alone_in
from ..runtime.tensor_files import require_same
from .adversary import Adversary
from .camouflaged import CamouflagedSamples
from .detector import Job, train
from .fit import describe
from .hardenable import origin_of
from .loop import RoundReport
from .measure import ALL, CAR, Findings, Score, measure
from .origin import Origin
from .settings import HardenSettings

FORMAT = ("rauca-hardening", 1)
RECORD = "hardening.json"
WORN = "camouflaged"  # name of the group of frames tested in the newest camouflage
CALM = 0.4  # a fine-tuning's learning rate, of the training's own
TESTED = 48  # frames at most that a round is watched on, in plain paint and in camouflage

Attack = Callable[[Detector, int, Path], Sequence[Path]]
"""Optimizes camouflages against a detector for the round of that number into a folder, going on where it stopped;
returns their JSON, the first one to be watched. It is handed in because the attack builds on detectors, and not the
other way round."""


@dataclass(frozen=True)
class Hardening:
    """What a hardening is given.

    Attributes:
        detector: as :func:`rauca_core.detect.load_detector` takes it.
        datasets: folders to train on, with light maps and of one image size.
        camouflages: JSON paths to train on beside those made on the way.
        out: folder for the weights and all on the way.
        attack, score: see the module, and `measure`.
        command: for the card.
        attacked: of ``datasets``, those that ``attack`` works on; a resumed run must share them.
        device: that learns and tests, and that ``attack``'s detector lies on.
    """

    detector: str
    datasets: Sequence[Path]
    camouflages: Sequence[Path]
    out: Path
    settings: HardenSettings
    attack: Attack
    score: Score
    command: str = ""
    attacked: Sequence[Path] = ()
    device: torch.device | str = "cpu"


@dataclass(frozen=True)
class HardenReport:
    """A test on the way: which round of how many, and what the fine-tuning reports.

    ``report.findings.ap50`` holds :data:`WORN` beside the plain frames' groups.
    """

    number: int
    rounds: int
    report: RoundReport[Findings]

    @property
    def summary(self) -> str:
        """AP@0.5 for a progress bar."""
        ap = self.report.findings.ap50
        worn = f", in camouflage {ap[WORN]:.3f}" if WORN in ap else ""
        return f"plain {ap[ALL]:.3f}{worn}"


OnTest = Callable[[HardenReport], None]
OnStep = Callable[[int, int, int, float], None]
"""Called with the round, steps done in it, steps of a round, and the loss."""


def harden(
    wanted: Hardening,
    on_test: OnTest = lambda report: None,
    on_step: OnStep = lambda number, done, steps, loss: None,
) -> Path:
    """Harden a detector, or go on; returns its weights, ``out/hardened-NAME`` with the suffix of its kind, their
    card beside them.

    A run resumed on the same machine ends in the same bits as one that never stopped.

    Raises:
        RaucaError: unusable data sets, camouflages, settings, folder or detector; a loss that is not finite; a stop.
    """
    origin = origin_of(wanted.detector)
    rounds = _Rounds(wanted, origin)
    with alone_in(wanted.out):
        _claim(wanted.out, rounds.identity)
        target = origin.hardened_in(wanted.out)
        if not target.with_suffix(".json").is_file():
            rounds.run(target, on_test, on_step)
    return target


def identity_of(wanted: Hardening) -> dict[str, Any]:
    """What a hardening depends on, as JSON; raises :class:`RaucaError` for a mistake in it, before any work."""
    return _Rounds(wanted, origin_of(wanted.detector)).identity


def _claim(out: Path, identity: dict[str, Any]) -> None:
    """Start a folder, or see that it holds this very hardening."""
    record = out / RECORD
    if not record.is_file():
        name, version = FORMAT
        write_json(record, {"format": name, "version": version, "identity": identity})
        return
    fields = read_json(record)
    fields.format(*FORMAT)
    found = fields.raw("identity")
    fields.done()
    require_same(out, "hardening", found, identity)


class _Rounds:
    """A hardening in progress."""

    def __init__(self, wanted: Hardening, origin: Origin) -> None:
        settings = wanted.settings
        if not (wanted.camouflages or settings.attack_steps):
            raise RaucaError("attack_steps: 0, and no camouflages given; there is nothing to harden against")
        self.wanted, self.origin, self.settings = wanted, origin, settings
        self.device = find_device(wanted.device)
        self.frames = LightFrames(wanted.datasets, settings.memory_mb)
        rendered = [d for number, d in enumerate(self.frames.datasets) if self.frames.has_rendered(number)]
        by: SplitBy = "location" if all(dataset.plan.locations > 1 for dataset in rendered) else "view"
        self.train, held_out = self.frames.split(by, settings.test_share, settings.seed)
        if not any(self.frames.vehicle(i).category == CAR for i in self.train):
            raise RaucaError("data sets: no frame to train on shows a car; add a data set of one, e.g. of the sedan")
        self.tested = [held_out[k] for k in np.linspace(0, len(held_out) - 1, min(TESTED, len(held_out))).astype(int)]
        self.samples(list(wanted.camouflages))  # mistakes are told before anything is done
        self.identity = {
            "detector": origin.fingerprint,
            "data": self.frames.digest,
            "camouflages": [file_digest(load_camouflage(path)[1]) for path in wanted.camouflages],
            **settings.identity(),
        }
        if settings.attack_steps:
            attacked = [wanted.datasets.index(folder) for folder in wanted.attacked]
            self.identity["choice of data sets to attack on"] = attacked

    def samples(self, camouflages: list[Path], share: float | None = None) -> CamouflagedSamples:
        """Frames in some of the camouflages; those to test on (``share`` 0 or 1) wear them as they are."""
        settings, card = self.settings, self.origin.card
        return CamouflagedSamples(
            self.frames,
            card.class_names,
            card.size,
            camouflages,
            self.wanted.out / "taps",
            settings.share if share is None else share,
            TapSettings(settings.map_size, settings.samples),
            varied=share is None,
            memory_mb=settings.memory_mb,
        )

    def run(self, target: Path, on_test: OnTest, on_step: OnStep) -> None:
        pool, weights, minutes = list(self.wanted.camouflages), None, 0.0
        for number in range(1, self.settings.rounds + 1):
            folder = self.wanted.out / f"round-{number}"
            after = folder / f"weights{self.origin.suffix}"
            detector = self.origin.detector() if weights is None else self.origin.opened(weights)
            detector.to(self.device)
            with counted_in(folder) as spent:
                if self.settings.attack_steps:
                    fresh = self.wanted.attack(detector, number, folder / "attack")
                    pool += fresh
                else:
                    fresh = pool[-1:]
                if not after.with_suffix(".json").is_file():
                    self._tune(number, weights, pool, fresh[0], after, spent, on_test, on_step)
            weights = after
            minutes += read_any_card(after.with_suffix(".json"))[0].cpu_minutes
        assert weights is not None
        network, card = self.origin.network(weights)[0], read_any_card(weights.with_suffix(".json"))[0]
        self.origin.save(target, network, replace(card, cpu_minutes=round(minutes, 2), hardened=self._against(pool)))

    def _tune(
        self,
        number: int,
        start: Path | None,
        pool: list[Path],
        watched: Path,
        after: Path,
        spent: Callable[[], float],
        on_test: OnTest,
        on_step: OnStep,
    ) -> None:
        """One round's fine-tuning, or the rest of it; ``spent`` tells the round's CPU minutes so far."""
        network, _ = self.origin.network(start)
        settings = self.settings.of_round(number, CALM * self.origin.lr)
        plain, worn = self.samples(pool, share=0.0), self.samples([watched], share=1.0)
        worn_by = [i for i in self.tested if self.wears(i, watched)]

        def test(average: nn.Module) -> Findings:
            detector = self.origin.detecting(average)
            found = measure(detector, plain, self.tested, self.wanted.score, self.settings.seed, self.device)
            if not worn_by:
                return found
            dressed = measure(detector, worn, worn_by, self.wanted.score, self.settings.seed, self.device)
            return replace(found, ap50={**found.ap50, WORN: dressed.ap50[ALL]})

        folder, samples = after.parent / "training", self.samples(pool)
        if self.settings.beside:
            samples.adversary = Adversary(samples.known, self.settings.beside, self.settings.attack_lr, settings.seed)
        known = [file_digest(load_camouflage(path)[1]) for path in pool]
        identity = {"data": self.frames.digest, "pool": known, "beside": self.settings.beside}
        job = Job(
            network, samples, self.train, test, settings, folder, identity, student=True,
            adversary=samples.adversary, device=self.device,
        )  # fmt: skip
        rounds = self.settings.rounds
        average, findings = train(
            job,
            lambda report: on_test(HardenReport(number, rounds, report)),
            lambda done, steps, loss: on_step(number, done, steps, loss),
        )
        self.origin.save(after, average, replace(self._card(number, findings), cpu_minutes=round(spent(), 3)))

    def wears(self, index: int, camouflage: Path) -> bool:
        """Whether the frame's vehicle is a car that the camouflage fits."""
        vehicle = self.frames.vehicle(index)
        return vehicle.category == CAR and vehicle.atlas_id == load_camouflage(camouflage)[0].atlas_id

    def _card(self, number: int, findings: Findings) -> DetectorCard:
        first, settings = self.origin.card, self.settings
        return replace(
            first,
            called=f"hardened-{first.called or first.name}",
            caution=HARDENED,
            backbone=self.origin.sha256,
            data=describe(self.frames, self.tested),
            command=self.wanted.command,
            seed=settings.seed,
            steps=number * settings.steps,
            settings=json.loads(settings.model_dump_json()),
            metrics=findings.to_json(),
            remarks="",
        )

    def _against(self, pool: Sequence[Path]) -> dict[str, Any]:
        """What the card tells of the camouflages that were trained on."""
        records = [load_camouflage(path)[0] for path in pool]
        return {
            "detector": self.origin.card.called or self.origin.card.name,
            "rounds": self.settings.rounds,
            "camouflages": [
                {"name": r.name, "vehicle": r.vehicle_name, "method": r.method, "against": r.made.get("detector", "")}
                for r in records
            ],
        }
