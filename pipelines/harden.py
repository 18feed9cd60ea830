"""Harden a detector and measure what it gained: ``rauca harden``.

Folder of a hardening, gone on with by ``--resume``; every step only makes what is missing::

    hardening.json                          what is hardened, on what, by which settings
    round-<k>/attack/                       the camouflage made against the detector of that round
    round-<k>/weights.safetensors, .json    the detector after it
    hardened-<name>.safetensors, .json      the result, loaded by its path
    adaptive/                               a camouflage made against the result
    study/                                  both detectors on held-out views, rendered by Cycles
    report.html, .csv, .json                before and after
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipelines.console import console, progress_bar
from pipelines.protocol import RandomPaint, Request, run_study
from pipelines.train_detector import command_line, score
from rauca_core.attack import OptimizerSettings, StepReport, make_settings, run_optimization
from rauca_core.contract import Dataset, Progress, RaucaError, load_camouflage, read_plan
from rauca_core.contract.files import file_digest
from rauca_core.contract.seeding import named_seed
from rauca_core.detect import Detector, load_detector
from rauca_core.report import HardeningNotes, write_hardening
from rauca_core.runtime.checkpoint_files import POINTER
from rauca_core.runtime.cpu import threads
from rauca_core.runtime.devices import find_device
from rauca_core.runtime.distributed import Processes
from rauca_core.study.contestants import (
    NORMAL,
    RANDOM,
    Contestant,
    VehicleChoice,
    match,
    read_contestants,
    read_vehicle_choice,
)
from rauca_core.study.defences import make_defence
from rauca_core.study.hardening import Gains, gains_of
from rauca_core.study.study import Entry
from rauca_core.study.views import HeldOut
from rauca_core.training.harden import Hardening, HardenReport, harden
from rauca_core.training.harden_settings import HardenSettings

ADAPTIVE = "adaptive"
RESERVED = (NORMAL, RANDOM, ADAPTIVE)
LIMITATIONS = (
    "The held-out camouflages were optimized against the detector before hardening and never trained on. The adaptive "
    "one was optimized against the hardened detector: it says how far a new attack of the same kind gets, and a longer "
    "or another one may get farther.",
    "One vehicle or a few, rendered: nothing here was measured on photographs.",
)


@dataclass(frozen=True)
class Wish:
    """What the user typed, checked.

    Attributes:
        detector: to harden.
        camouflages, held_out: ``FILE`` or ``LABEL=FILE``: to train on, and to judge by.
        data: data sets with light maps to train on; the first of each vehicle is what the adaptive attack uses.
        out: the folder of all.
        adaptive_steps: of the attack on the result; 0 makes none.
        views: rendered views to evaluate on; made anew, in ``weathers``, when there are none.
        held_out_views: how.
        device: that attacks, learns and measures.
    """

    detector: str
    camouflages: Sequence[Path]
    held_out: Sequence[str]
    data: Sequence[Path]
    out: Path
    settings: HardenSettings
    adaptive_steps: int
    views: Sequence[Path]
    weathers: Sequence[str]
    held_out_views: HeldOut
    resamples: int = 1000
    blender: Path | None = None
    device: str = "cpu"


def harden_detector(wish: Wish, resume: bool) -> tuple[Path, list[Gains]]:
    """Harden with progress bars, evaluate and report; returns the weights and what they gained."""
    contestants = _contestants(wish)
    chosen = _vehicles(wish, contestants)
    weights = _harden(wish, _attacked(wish, chosen), resume)
    adaptive = _adaptive(wish, weights, chosen)
    entries = _evaluate(wish, weights, chosen, adaptive)
    before, after = load_detector(wish.detector).name, load_detector(str(weights)).name
    gains = [gains_of(entry, before, after, [c.label for c in _of(chosen, entry)]) for entry in entries]
    notes = HardeningNotes(before, after, _made(contestants, adaptive), _facts(wish), command_line(), LIMITATIONS)
    for path in write_hardening(gains, entries, wish.out / "report.html", notes):
        console.print(f"report: {path}", highlight=False, soft_wrap=True)
    return weights, gains


def _contestants(wish: Wish) -> list[Contestant]:
    """The held-out camouflages; refuses one that is trained on."""
    contestants = read_contestants(wish.held_out, RESERVED)
    if not contestants:
        raise RaucaError("--held-out: none given; a hardened detector is judged by camouflages it was not trained on")
    trained = {file_digest(load_camouflage(path)[1]): path for path in wish.camouflages}
    trained |= {file_digest(png): png.with_suffix(".json") for png in wish.out.glob("round-*/attack/camouflage.png")}
    for contestant in contestants:
        if path := trained.get(file_digest(contestant.path.with_suffix(".png"))):
            raise RaucaError(f"{contestant.path}: the same UV map as {path}; what is trained on cannot be held out")
    return contestants


def _vehicles(wish: Wish, contestants: Sequence[Contestant]) -> Mapping[VehicleChoice, list[Contestant]]:
    """The vehicles of the held-out camouflages, each with a data set to train on."""
    first = {read_plan(folder).atlas_id: Dataset(folder).vehicle_folder for folder in reversed(wish.data)}
    for contestant in contestants:
        record = contestant.record
        if record.atlas_id not in first:
            raise RaucaError(
                f"{contestant.path}: made for {record.vehicle_name} (UV atlas {record.atlas_id}), which no data set "
                "shows; add one of that vehicle with --data"
            )
    chosen = match(contestants, [read_vehicle_choice(folder) for folder in first.values()], everyone=False)
    atlases = {vehicle.atlas_id for vehicle in chosen}
    for folder in wish.views:
        if read_plan(folder).atlas_id not in atlases:
            raise RaucaError(f"{folder}: views of a vehicle that no held-out camouflage fits; give views of that one")
    return chosen


def _attacked(wish: Wish, chosen: Mapping[VehicleChoice, object]) -> list[Path]:
    """The data sets that rounds attack on, by turns: those of the held-out camouflages' vehicles."""
    atlases = {vehicle.atlas_id for vehicle in chosen}
    return [folder for folder in wish.data if read_plan(folder).atlas_id in atlases]


def _harden(wish: Wish, attacked: Sequence[Path], resume: bool) -> Path:
    """All rounds behind one bar, which counts steps of attacks and of fine-tuning."""
    chosen, said = wish.settings, ""
    a_round = chosen.attack_steps + chosen.steps

    with progress_bar(f"hardening {wish.detector}") as move:

        def show(number: int, done: int, what: str) -> None:
            move(Progress((number - 1) * a_round + done, chosen.rounds * a_round, f"round {number}  {what}{said}"))

        def attack(detector: Detector, number: int, folder: Path) -> Path:
            dataset = attacked[(number - 1) % len(attacked)]
            settings = _attack_settings(wish, f"round-{number}", chosen.attack_steps, number)
            return _optimize(
                wish, dataset, detector, settings, folder,
                lambda r: show(number, r.step, f"attack, score {r.score:.2f}"),
            )  # fmt: skip

        def show_step(number: int, done: int, steps: int, loss: float) -> None:
            show(number, chosen.attack_steps + done, f"loss {loss:.3f}")

        def show_test(found: HardenReport) -> None:
            nonlocal said
            said = f"  AP@0.5 {found.summary}"
            if not console.is_terminal:
                report = found.report
                step = f"step {report.step}/{report.steps}"
                console.print(f"round {found.number} of {found.rounds}, {step}: loss {report.loss:.3f}{said}")

        wanted = Hardening(
            wish.detector, wish.data, wish.camouflages, wish.out, chosen, attack, score, command_line(), attacked,
            wish.device,
        )  # fmt: skip
        return harden(wanted, resume, show_test, show_step)


def _adaptive(wish: Wish, weights: Path, chosen: Mapping[VehicleChoice, Sequence[Contestant]]) -> dict[str, Path]:
    """A camouflage against the result for each vehicle, by UV atlas."""
    made = {}
    for vehicle in chosen if wish.adaptive_steps else ():
        dataset = next(folder for folder in wish.data if read_plan(folder).atlas_id == vehicle.atlas_id)
        settings = _attack_settings(wish, ADAPTIVE, wish.adaptive_steps, ADAPTIVE)
        folder = wish.out / ADAPTIVE / vehicle.name
        with progress_bar(f"{vehicle.name}: attacking the hardened detector") as move:
            made[vehicle.atlas_id] = _optimize(
                wish, dataset, load_detector(str(weights)), settings, folder,
                lambda r: move(Progress(r.step, r.steps, f"score {r.score:.2f}")),
            )  # fmt: skip
    return made


def _attack_settings(wish: Wish, name: str, steps: int, what: object) -> OptimizerSettings:
    chosen = wish.settings
    return make_settings(
        steps=steps, batch=chosen.attack_batch, lr=chosen.attack_lr, map_size=chosen.map_size, samples=chosen.samples,
        seed=named_seed(chosen.seed, "attack", what), threads=chosen.threads, memory_mb=chosen.memory_mb, name=name,
        precision=chosen.precision, tap_folder=wish.out / "taps", checkpoint_every=50,
    )  # fmt: skip


def _optimize(
    wish: Wish,
    dataset: Path,
    detector: Detector,
    settings: OptimizerSettings,
    folder: Path,
    on_step: Callable[[StepReport], None],
) -> Path:
    """Optimize, or go on, also to more steps than it was finished with; what has as many is left as it is."""
    done = folder / "camouflage.json"
    if done.is_file():
        steps = load_camouflage(done)[0].made.get("steps")
        if steps == settings.steps:
            return done
        if isinstance(steps, int) and steps > settings.steps:
            raise RaucaError(f"{done}: took {steps} steps, not {settings.steps}; ask for as many, or remove {folder}")
    started = (folder / "checkpoints" / POINTER).is_file()
    processes = Processes(0, 1, find_device(wish.device))
    return run_optimization(Dataset(dataset), [detector], settings, folder, on_step, started, processes=processes)


def _evaluate(
    wish: Wish,
    weights: Path,
    chosen: Mapping[VehicleChoice, Sequence[Contestant]],
    adaptive: Mapping[str, Path],
) -> list[Entry]:
    detectors = [load_detector(name, device=wish.device) for name in (wish.detector, str(weights))]
    datasets: dict[str, list[Dataset]] = {}
    for folder in wish.views:
        datasets.setdefault(read_plan(folder).atlas_id, []).append(Dataset(folder))

    def also(vehicle: VehicleChoice) -> list[Contestant]:
        path = adaptive.get(vehicle.atlas_id)
        return [Contestant(ADAPTIVE, path, load_camouflage(path)[0])] if path else []

    request = Request(
        command=command_line(),
        out=wish.out / "study",
        contestants={vehicle: [*some, *also(vehicle)] for vehicle, some in chosen.items()},
        detectors={vehicle.category: detectors for vehicle in chosen},
        defences=[make_defence("none")],
        weathers=wish.weathers,
        held_out=wish.held_out_views,
        datasets=datasets,
        random=RandomPaint(),
        resamples=wish.resamples,
        blender=wish.blender,
        device=wish.device,
    )
    with threads(wish.settings.threads):
        return run_study(request)


def _of(chosen: Mapping[VehicleChoice, Sequence[Contestant]], entry: Entry) -> Sequence[Contestant]:
    return next(some for vehicle, some in chosen.items() if vehicle.name == entry.vehicle)


def _made(contestants: Sequence[Contestant], adaptive: Mapping[str, Path]) -> dict[str, str]:
    """How each paint was made, for the report."""
    made = {NORMAL: "the vehicle's own paint", RANDOM: "random cells, optimized against nothing"}
    made |= {c.label: f"held out; {_origin(c.path)}" for c in contestants}
    if adaptive:
        made[ADAPTIVE] = f"made after hardening; {_origin(next(iter(adaptive.values())))}"
    return made


def _origin(path: Path) -> str:
    record, _ = load_camouflage(path)
    made = record.made
    steps, against, seed = (made.get(name, "?") for name in ("steps", "detector", "seed"))
    return f"{record.method}, {steps} steps against {against}, seed {seed}"


def _facts(wish: Wish) -> dict[str, object]:
    return {
        "detector": Path(wish.detector).name,
        "data sets": ", ".join(folder.name for folder in wish.data),
        "camouflages trained on": ", ".join(load_camouflage(p)[0].name for p in wish.camouflages) or "none given",
        **wish.settings.model_dump(mode="json", exclude={"threads", "memory_mb"}),
        "adaptive attack, steps": wish.adaptive_steps,
    }
