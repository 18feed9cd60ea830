"""The hardening as a step of a study: the attack that opens each round, and the score that watches it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..attack import OptimizerSettings, StepReport, make_settings, run_optimization, settings_of
from ..attack.methods import method_named
from ..contract import Dataset, Progress, load_camouflage
from ..contract.seeding import named_seed
from ..detect import Detector
from ..training.harden import Hardening, HardenReport, harden
from ..training.measure import Judged
from ..training.settings import HardenSettings
from .average_precision import Sample, average_precision
from .job import Machine

STRONGEST = "ours"  # of the methods: what a hardened detector is measured by
Report = Callable[[Progress], None]


def score(judged: Sequence[Judged]) -> float:
    """AP@0.5 as the evaluation computes it."""
    return average_precision([Sample(one.truth, one.boxes, one.scores) for one in judged])


def attack_settings(
    settings: HardenSettings,
    name: str,
    steps: int,
    what: object,
    taps: Path,
    method: str = STRONGEST,
    begin_with: Path | None = None,
    turn: int = 0,
    free: bool = False,
) -> OptimizerSettings:
    """Of an attack in a hardening, or of one that measures it.

    Args:
        what: names its random streams.
        method: whose settings it takes. The hardening's learning rate is for free texels, its subsamples for all but
            facets, which are read as Neural Renderer does.
        begin_with: a camouflage to go on from.
        turn: of how many attacks it is, counted from 0: whose patch size it takes.
        free: leave its texels free in place of patches: those of ``begin_with`` are then what it begins with.
    """
    own = method_named(method).settings
    chosen: dict[str, Any] = {} if own.get("paint") == "facets" else {"samples": settings.samples}
    if paints_texels(method):
        chosen["lr"] = settings.attack_lr
    if "natural" in own and not free:
        patches = settings.attack_patches
        chosen["natural"] = own["natural"].model_copy(update={"feature_cm": patches[turn % len(patches)]})
    if begin_with is not None:
        chosen["begin_with"] = begin_with
    return make_settings(**settings_of(
        method, None, steps=steps, batch=settings.attack_batch, map_size=settings.map_size, **chosen,
        seed=named_seed(settings.seed, "attack", what), threads=settings.threads, memory_mb=settings.memory_mb,
        name=name, precision=settings.precision, tap_folder=taps, checkpoint_every=50,
    ))  # fmt: skip


def paints_texels(method: str) -> bool:
    """Whether it paints free texels of the UV map, and so can begin with any camouflage."""
    return bool(method_named(method).settings.get("paint", "texels") == "texels")


def attack_folder(out: Path, number: int, restart: int) -> Path:
    """Of one of a round's attacks, in the folder of a hardening."""
    folder = out / f"round-{number}" / "attack"
    return folder / f"restart-{restart}" if restart else folder


def grown_from(out: Path, number: int, restart: int, atlas_id: str) -> Path | None:
    """The camouflage that the attack of that number in the newest earlier round ended with, on the same vehicle."""
    for earlier in range(number - 1, 0, -1):
        path = attack_folder(out, earlier, restart) / "camouflage.json"
        if load_camouflage(path)[0].atlas_id == atlas_id:
            return path
    return None


def given_for(atlas_id: str, camouflages: Sequence[str]) -> Path | None:
    """The first of some camouflages (JSON) that fits a vehicle."""
    return next((Path(path) for path in camouflages if load_camouflage(Path(path))[0].atlas_id == atlas_id), None)


def hardening(
    options: dict[str, Any], out: Path, machine: Machine, report: Report = lambda progress: None
) -> Hardening:
    """What a recipe's options ask for, in a folder.

    Args:
        options: ``detector``, ``datasets``, ``attacked``, ``camouflages``, ``settings`` and ``command``.
        report: told of the steps of attacks.
    """
    settings, attacked = HardenSettings.make(**options["settings"]), list(map(Path, options["attacked"]))
    for method in settings.attack_methods:
        method_named(method)

    def attack(detector: Detector, number: int, folder: Path) -> list[Path]:
        """The round's optimizations, or the rest of them where an earlier process stopped."""
        return [one_attack(detector, number, restart) for restart in range(settings.attack_restarts)]

    def one_attack(detector: Detector, number: int, restart: int) -> Path:
        """The last one of a round grows over the rounds, where its method can; the others begin with noise.

        It grows from a given camouflage that fits, whose texels are left free. Without one it grows from noise, and so
        not where it is the only one.
        """
        folder, name = attack_folder(out, number, restart), f"round-{number}" + (f".{restart}" if restart else "")
        if (folder / "camouflage.json").is_file():
            return folder / "camouflage.json"
        turn, length = (number - 1) * settings.attack_restarts + restart, settings.attack_length(number)
        method = settings.attack_methods[turn % len(settings.attack_methods)]
        dataset = Dataset(attacked[turn % len(attacked)])
        what = (number, restart) if restart else number
        last, atlas = restart == settings.attack_restarts - 1 and paints_texels(method), dataset.plan.atlas_id
        given = given_for(atlas, options["camouflages"]) if last else None
        grows = last and (restart > 0 or given is not None)
        begun = grown_from(out, number, restart, atlas) or given if grows else None
        chosen = attack_settings(settings, name, length, what, out / "taps", method, begun, turn, given is not None)

        def show(step: StepReport) -> None:
            done = done_before(settings, number) + restart * length + step.step
            report(Progress(done, work_of(settings), f"round {number}  attack, score {step.score:.2f}"))

        return run_optimization(dataset, [detector], chosen, folder, show, None, machine.processes)

    return Hardening(
        options["detector"], list(map(Path, options["datasets"])), list(map(Path, options["camouflages"])), out,
        settings, attack, score, options["command"], attacked, machine.device,
    )  # fmt: skip


def done_before(settings: HardenSettings, number: int) -> int:
    """Steps of attacks and of fine-tuning before a round."""
    earlier = settings.model_copy(update={"rounds": number - 1})
    return earlier.attack_budget + (number - 1) * settings.steps


def work_of(settings: HardenSettings) -> int:
    """Steps of attacks and of fine-tuning in all."""
    return done_before(settings, settings.rounds + 1)


def run_hardening(options: dict[str, Any], out: Path, machine: Machine, report: Report) -> Path:
    """Harden in a folder, or go on there; returns the weights."""
    wanted, told = hardening(options, out, machine, report), ""
    settings = wanted.settings

    def show_step(number: int, done: int, steps: int, loss: float) -> None:
        done += done_before(settings, number) + settings.attack_restarts * settings.attack_length(number)
        report(Progress(done, work_of(settings), f"round {number}  loss {loss:.3f}{told}"))

    def show_test(found: HardenReport) -> None:
        nonlocal told
        told = f"  AP@0.5 {found.summary}"

    return harden(wanted, show_test, show_step)
