"""Optimizing a camouflage end to end, from an empty folder to a UV map anyone can load."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from ..contract import Camouflage, Dataset, RaucaError, StoppedError, load_vehicle, save_camouflage
from ..contract.files import png_bytes
from ..contract.vehicle import target_class
from ..detect import Detector, load_detector
from ..runtime.devices import keep_large_blocks, threads
from ..runtime.distributed import SINGLE_PROCESS, Processes, joined_processes
from ..runtime.images import read_image
from ..runtime.stopping import stop_request
from ..runtime.tensor_files import CHECKPOINTS, held_run, load_checkpoint, require_same
from .ensemble import DetectorEnsemble
from .history import CURVES, HISTORY, Recorder, StepReport, read_history
from .methods import method_named, settings_of
from .naturalness.texture import NaturalColors, finish
from .paint import Paint, load_paint, map_png
from .run import Run
from .settings import OptimizerSettings, make_settings

TAPS = "taps"
AVERAGED_STEPS = 50
UNFINISHED = "unfinished.json"  # of a stopped run: no reader takes it for a finished one
OnStep = Callable[[StepReport], None]
OnView = Callable[[int, int], None]


def optimize(
    data: Dataset | Path | str,
    detectors: Sequence[Detector | str] = (),
    method: str | None = "ours",
    *,
    steps: int = 3000,
    device: torch.device | str | None = None,
    out: Path | str | None = None,
    on_step: OnStep | None = None,
    on_view: OnView | None = None,
    **settings: Any,
) -> Paint:
    """Optimize a camouflage on a data set against one or several detectors.

    Args:
        data: a data set with light maps, or its folder; frames that do not show the vehicle are skipped.
        detectors: loaded ones, or names and files as `load_detector` takes them; they are moved to ``device``. The
            method's own panel, at its size, if there are none.
        method: whose settings to begin with, a key of `methods.METHODS`; None for those of `OptimizerSettings`.
        steps: gradient steps in all.
        device: of the texture, the pictures and the detectors; a GPU if there is one, as the log says, when None. Run
            by ``torchrun``, all processes share every step.
        out: folder of the run, see :func:`run_optimization`; a temporary one if left out.
        on_step: called after every step.
        on_view: called, from another thread, with the cameras that are ready and how many there are.
        settings: fields of `OptimizerSettings`, which win over the method's; ``target``, the class to hide, is the
            vehicle's own if left out.

    Raises:
        RaucaError: see :func:`run_optimization`; an unknown method, detector or setting.
    """
    given = {**settings, "steps": steps}
    if method is None and settings.get("fidelity") is not None:
        raise RaucaError(f"--as {settings['fidelity']}: is a form of a method; name the method with --method")
    chosen = make_settings(**(given if method is None else settings_of(method, **given)))
    dataset = data if isinstance(data, Dataset) else Dataset(Path(data))
    if settings.get("target") is None:
        hidden = target_class(load_vehicle(dataset.vehicle_folder, read_image).category)
        chosen = chosen.model_copy(update={"target": hidden})
    attacked, size = method_named(method or "rauca-final").attacked(detectors, chosen.detector_size)
    chosen = chosen.model_copy(update={"detector_size": size})
    place = contextlib.nullcontext(out) if out is not None else tempfile.TemporaryDirectory("rauca")
    with joined_processes(device) as processes, place as folder:
        loaded = [load_attacked(d, size, processes.device) if isinstance(d, str) else d for d in attacked]
        path = run_optimization(dataset, loaded, chosen, Path(folder), on_step, on_view, processes)
        processes.any(False)  # the first one writes what all read now
        made = load_paint(path)
        return replace(made, history=read_history(path.parent), path=None if out is None else path)


def load_attacked(name: str, size: int | None, device: torch.device | str = "cpu") -> Detector:
    """A detector at the size asked for; one whose size is its own enlarges the pictures of that size to it."""
    if size is not None:
        with contextlib.suppress(RaucaError):  # its size is its own; any other mistake is met again
            return load_detector(name, size, device)
    return load_detector(name, device=device)


def run_optimization(
    dataset: Dataset,
    detectors: Sequence[Detector],
    settings: OptimizerSettings,
    out: Path,
    on_step: OnStep | None = None,
    on_view: OnView | None = None,
    processes: Processes = SINGLE_PROCESS,
) -> Path:
    """What :func:`optimize` does, in a folder, for callers that have made up the settings.

    ``out`` receives ``camouflage.json`` and ``.png``, ``history.jsonl``, ``tensorboard/``, ``checkpoints/`` and, while
    the run goes on, the pictures of `history`. Where a run was stopped there, this one goes on; on the same machine it
    ends in the same bits as one that never stopped. A stopped run leaves the camouflage of its last step as
    ``unfinished.json`` and ``.png``.

    Args:
        dataset: with light maps; frames without a box are skipped.
        detectors: their class names must hold ``settings.target``; they are moved to the processes' device.
        on_step: called after every step in the leading process; progress bars are the caller's business.
        on_view: called, from another thread, with the cameras whose taps are built and how many there are.
        processes: that share every batch; they end as one would, but for the order of sums.

    Returns:
        The path of ``camouflage.json``.

    Raises:
        RaucaError: unusable data set, detector or folder; a folder that holds another run, or one of more steps, or
            another process at work there; a loss or gradient that is not finite (the frame is named); a stop by Ctrl-C
            or SIGTERM, after a checkpoint.
    """
    out = Path(out)
    with held_run(out, processes) as begun:
        if settings.tap_folder is None and not os.access(dataset.folder, os.W_OK):  # a data set on a read-only disk
            settings = settings.model_copy(update={"tap_folder": out / TAPS})
        keep_large_blocks()
        moved = [detector.to(processes.device) for detector in detectors]
        ensemble = DetectorEnsemble(moved, settings.target, settings.weights, settings.precision, settings.objective)
        with threads(settings.threads):
            run = Run(dataset, ensemble, settings, processes)
            try:
                if begun:
                    _go_on(run, out)
                with run.store.warming(run.order.upcoming(), on_view):
                    _loop(run, out, on_step)
            finally:
                run.close()
            stopped = run.step < settings.steps
            if processes.is_main:
                _write_result(run, out / UNFINISHED if stopped else out / "camouflage.json")
            if stopped:
                raise StoppedError(
                    f"{out}: stopped after step {run.step} of {settings.steps}; the camouflage so far is {UNFINISHED}"
                )
            for left in (out / UNFINISHED, (out / UNFINISHED).with_suffix(".png")):
                left.unlink(missing_ok=True)
            return out / "camouflage.json"


def _go_on(run: Run, out: Path) -> None:
    """Go back to the latest checkpoint in ``out``; raises :class:`RaucaError` for one of another or a longer run."""
    checkpoint, steps = load_checkpoint(out / CHECKPOINTS), run.settings.steps
    require_same(out, "run", checkpoint.identity, run.identity)
    if checkpoint.step > steps:
        raise RaucaError(
            f"{out}: holds a run of {checkpoint.step} steps already; "
            f"choose another folder for one of {steps}, or give more"
        )
    run.restore(checkpoint)


def _loop(run: Run, out: Path, on_step: OnStep | None) -> None:
    """Step, report and checkpoint until done or asked to stop."""
    total, every = run.settings.steps, run.settings.checkpoint_every
    record = contextlib.closing(Recorder(out, run.step)) if run.processes.is_main else contextlib.nullcontext()
    with record as recorder, stop_request() as stop:
        stopping = False
        while run.step < total and not stopping:
            report = run.advance()
            if recorder is not None:
                recorder.add(report, run.pictures)
                if on_step is not None:
                    on_step(report)
            stopping = run.processes.any(bool(stop))
            if recorder is not None and (run.step % every == 0 or run.step == total or stopping):
                recorder.save(run.checkpoint(), *run.pictures())


def _write_result(run: Run, path: Path) -> None:
    """Write a camouflage, ``path`` (.json) and the .png beside it; losses are means over the history's last steps.

    Raises:
        RaucaError: a history without a step, or damaged.
    """
    last, settings, texture = read_history(path.parent)[-AVERAGED_STEPS:], run.settings, run.texture
    if not last:
        raise RaucaError(
            f"{path.parent / HISTORY}: holds no step of the run; bring it back, or start anew in another folder"
        )
    made: dict[str, Any] = {
        "detector": run.ensemble.name,
        "steps": run.step,
        "seed": settings.seed,
        "final_losses": {name: sum(r[name] for r in last) / len(last) for name in CURVES},
        "settings": settings.identity(),
    }
    if isinstance(texture, NaturalColors):
        uv_map, made["natural"] = finish(texture.constraints, texture.texels())
        png = png_bytes(uv_map)
    else:
        png = map_png(run.store.pyramid, texture.texels())
    vehicle = run.store.vehicle
    record = Camouflage(settings.name, vehicle.name, vehicle.atlas_id, settings.map_size, settings.method, made)
    save_camouflage(path, record, png)
