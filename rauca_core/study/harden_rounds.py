"""The hardening as a step of a study: the attack that opens each round, and the score that watches it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..attack import OptimizerSettings, StepReport, make_settings, run_optimization
from ..contract import Dataset, Progress
from ..contract.seeding import named_seed
from ..detect import Detector
from ..runtime.tensor_files import started
from ..training.harden import RECORD, Hardening, HardenReport, harden
from ..training.measure import Judged
from ..training.settings import HardenSettings
from .average_precision import Sample, average_precision
from .job import Machine

Report = Callable[[Progress], None]


def score(judged: Sequence[Judged]) -> float:
    """AP@0.5 as the evaluation computes it."""
    return average_precision([Sample(one.truth, one.boxes, one.scores) for one in judged])


def attack_settings(settings: HardenSettings, name: str, steps: int, what: object, taps: Path) -> OptimizerSettings:
    """Of an attack in a hardening, or of the one on its result; ``what`` names its random streams."""
    return make_settings(
        steps=steps, batch=settings.attack_batch, lr=settings.attack_lr, map_size=settings.map_size,
        samples=settings.samples, seed=named_seed(settings.seed, "attack", what), threads=settings.threads,
        memory_mb=settings.memory_mb, name=name, precision=settings.precision, tap_folder=taps, checkpoint_every=50,
    )  # fmt: skip


def hardening(
    options: dict[str, Any], out: Path, machine: Machine, report: Report = lambda progress: None
) -> Hardening:
    """What a recipe's options ask for, in a folder.

    Args:
        options: ``detector``, ``datasets``, ``attacked``, ``camouflages``, ``settings`` and ``command``.
        report: told of the steps of attacks.
    """
    settings, attacked = HardenSettings.make(**options["settings"]), list(map(Path, options["attacked"]))
    a_round = settings.attack_steps + settings.steps

    def attack(detector: Detector, number: int, folder: Path) -> Path:
        """Optimize, or go on where an earlier process stopped."""
        if (folder / "camouflage.json").is_file():
            return folder / "camouflage.json"
        chosen = attack_settings(settings, f"round-{number}", settings.attack_steps, number, out / "taps")
        dataset = Dataset(attacked[(number - 1) % len(attacked)])

        def show(step: StepReport) -> None:
            done, said = (number - 1) * a_round + step.step, f"round {number}  attack, score {step.score:.2f}"
            report(Progress(done, settings.rounds * a_round, said))

        return run_optimization(dataset, [detector], chosen, folder, show, started(folder), None, machine.processes)

    return Hardening(
        options["detector"], list(map(Path, options["datasets"])), list(map(Path, options["camouflages"])), out,
        settings, attack, score, options["command"], attacked, machine.device,
    )  # fmt: skip


def run_hardening(options: dict[str, Any], out: Path, machine: Machine, report: Report) -> Path:
    """Harden in a folder, or go on there; returns the weights."""
    wanted, told = hardening(options, out, machine, report), ""
    settings = wanted.settings
    a_round = settings.attack_steps + settings.steps

    def show_step(number: int, done: int, steps: int, loss: float) -> None:
        done += (number - 1) * a_round + settings.attack_steps
        report(Progress(done, settings.rounds * a_round, f"round {number}  loss {loss:.3f}{told}"))

    def show_test(found: HardenReport) -> None:
        nonlocal told
        told = f"  AP@0.5 {found.summary}"

    return harden(wanted, (out / RECORD).is_file(), show_test, show_step)
