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

from ..contract import (
    Camouflage,
    Dataset,
    RaucaError,
    StoppedError,
    Vehicle,
    load_vehicle,
    save_camouflage,
)
from ..contract.files import png_bytes, sweep_partials
from ..contract.vehicle import target_class
from ..detect import Detector, load_detector
from ..render import Pyramid
from ..runtime.checkpoint_files import POINTER, differences
from ..runtime.cpu import keep_large_blocks, threads
from ..runtime.devices import find_device
from ..runtime.distributed import SINGLE_PROCESS, Processes
from ..runtime.folder_lock import alone_in
from ..runtime.images import read_image
from ..runtime.stopping import stop_request
from .checkpoint import check_identity, load_checkpoint, save_checkpoint
from .ensemble import DetectorEnsemble
from .frames import FrameStore
from .history import CURVES, HISTORY, History, Preview, StepReport, read_history
from .methods import settings_of
from .naturalness.texture import NaturalColors, finish
from .paint import Paint, load_paint
from .run import Run, identity_of
from .settings import OptimizerSettings, make_settings
from .texture import Texture, map_png

CHECKPOINTS, TAPS = "checkpoints", "taps"
AVERAGED_STEPS = 50
OnStep = Callable[[StepReport], None]
OnView = Callable[[int, int], None]


def optimize(
    data: Dataset | Path | str,
    detectors: Sequence[Detector | str],
    method: str = "ours",
    *,
    steps: int = 1000,
    device: torch.device | str = "cpu",
    out: Path | str | None = None,
    on_step: OnStep | None = None,
    resume: bool = False,
    **settings: Any,
) -> Paint:
    """Optimize a camouflage on a data set against one or several detectors.

    Args:
        data: a data set with light maps, or its folder; frames that do not show the vehicle are skipped.
        detectors: loaded ones, or names and files as `load_detector` takes them; they are moved to ``device``.
        method: whose settings to begin with, a key of `methods.METHODS`.
        steps: gradient steps in all.
        device: of the texture, the pictures and the detectors.
        out: folder of the run, see :func:`run_optimization`; a temporary one if left out.
        on_step: called after every step.
        resume: go on from the latest checkpoint in ``out``.
        settings: fields of `OptimizerSettings`, which win over the method's; ``target``, the class to hide, is the
            vehicle's own if left out.

    Raises:
        RaucaError: see :func:`run_optimization`; an unknown method, detector or setting.
    """
    dataset = data if isinstance(data, Dataset) else Dataset(Path(data))
    settings.setdefault("target", target_class(load_vehicle(dataset.vehicle_folder, read_image).category))
    chosen = make_settings(**settings_of(method, **settings, steps=steps))
    loaded = [load_detector(d, chosen.detector_size, device) if isinstance(d, str) else d for d in detectors]
    processes = Processes(0, 1, find_device(device))
    with contextlib.nullcontext(out) if out is not None else tempfile.TemporaryDirectory("rauca") as folder:
        path = run_optimization(dataset, loaded, chosen, Path(folder), on_step, resume, processes=processes)
        made = load_paint(path)
        return replace(made, history=read_history(path.parent), path=None if out is None else path)


def run_optimization(
    dataset: Dataset,
    detectors: Sequence[Detector],
    settings: OptimizerSettings,
    out: Path,
    on_step: OnStep | None = None,
    resume: bool = False,
    on_view: OnView | None = None,
    processes: Processes = SINGLE_PROCESS,
) -> Path:
    """What :func:`optimize` does, in a folder, for callers that have made up the settings.

    ``out`` receives ``camouflage.json`` and ``.png``, ``history.jsonl``, ``tensorboard/``, ``checkpoints/`` and, while
    the run goes on, the pictures of `history`. A run resumed on the same machine ends in the same bits as one that
    never stopped.

    Args:
        dataset: with light maps; frames without a box are skipped.
        detectors: their class names must hold ``settings.target``; they are moved to the processes' device.
        on_step: called after every step in the leading process; progress bars are the caller's business.
        resume: go on from the latest checkpoint in ``out``.
        on_view: called, from another thread, with the cameras whose taps are built and how many there are.
        processes: that share every batch; they end as one would, but for the order of sums.

    Returns:
        The path of ``camouflage.json``.

    Raises:
        RaucaError: unusable data set, detector or folder, or another process at work there; a loss or gradient that is
            not finite (the frame is named); a stop by Ctrl-C or SIGTERM, after a checkpoint.
    """
    out = Path(out)
    with alone_in(out) if processes.is_main else contextlib.nullcontext():
        _require_state(out, resume)
        if settings.tap_folder is None and not os.access(dataset.folder, os.W_OK):  # a data set on a read-only disk
            settings = settings.model_copy(update={"tap_folder": out / TAPS})
        keep_large_blocks()
        moved = [detector.to(processes.device) for detector in detectors]
        ensemble = DetectorEnsemble(moved, settings.target, settings.weights, settings.precision, settings.objective)
        with threads(settings.threads):
            run = Run(dataset, ensemble, settings, processes)
            try:
                if resume:
                    checkpoint = load_checkpoint(out / CHECKPOINTS)
                    check_identity(out, checkpoint.identity, run.identity)
                    if checkpoint.step > settings.steps:
                        raise RaucaError(
                            f"{out}: holds a run after step {checkpoint.step}, beyond --steps {settings.steps}; "
                            "ask for more steps, or start anew in another folder"
                        )
                    run.restore(checkpoint)
                with run.store.warming(run.order.upcoming(), on_view):
                    _loop(run, out, on_step)
            finally:
                run.close()
            if not processes.is_main:
                return out / "camouflage.json"
            return _write_result(out, run.store.vehicle, run.store.pyramid, run.texture, settings, ensemble.name)


def unlike(dataset: Dataset, detectors: Sequence[Detector], settings: OptimizerSettings, out: Path) -> list[str]:
    """What the finished run in ``out`` depends on that :func:`optimize` would do otherwise, by name."""
    ensemble = DetectorEnsemble(detectors, settings.target, settings.weights, settings.precision, settings.objective)
    wanted = identity_of(dataset, FrameStore(dataset, settings), ensemble, settings)
    checkpoint = load_checkpoint(out / CHECKPOINTS)
    steps = ["number of steps"] if checkpoint.step != settings.steps else []
    return steps + [name for name in differences(checkpoint.identity, wanted) if name not in ("taps", "processes")]


def _require_state(out: Path, resume: bool) -> None:
    """Refuse to start where a run is, and to resume where none is."""
    started = (out / CHECKPOINTS / POINTER).is_file()
    if started != resume:
        hint = "resume it or choose another folder" if started else "start it without resuming"
        raise RaucaError(f"{out}: holds {'a' if started else 'no'} run with checkpoints; {hint}")


def _loop(run: Run, out: Path, on_step: OnStep | None) -> None:
    """Step, report and checkpoint until done or asked to stop."""
    total, every = run.settings.steps, run.settings.checkpoint_every
    recorder = _Recorder(run, out)
    try:
        with stop_request() as stop:
            stopping = False
            while run.step < total and not stopping:
                report = run.advance()
                recorder.add(report)
                if on_step is not None and run.processes.is_main:
                    on_step(report)
                stopping = run.processes.any(bool(stop))
                if run.step % every == 0 or run.step == total or stopping:
                    recorder.save()
            if run.step < total:
                recorder.save()
                raise StoppedError(f"{out}: stopped after step {run.step} of {total}")
    finally:
        recorder.close()


class _Recorder:
    """Writes history, previews and checkpoints, in the leading process."""

    def __init__(self, run: Run, out: Path) -> None:
        self._run, self._out, self._saved = run, out, run.step
        if run.processes.is_main:
            sweep_partials(out)  # of a run that was killed in the middle of a file
        self._history = History(out, run.step) if run.processes.is_main else None
        self._preview = Preview(out)

    def add(self, report: StepReport) -> None:
        if self._history is not None:
            self._history.add(report)
            if self._preview.due:
                self._preview.show(self._run.uv_map_srgb(), self._run.last_image)

    def save(self) -> None:
        """Bring what is on disk up to this step."""
        run = self._run
        if self._history is None or self._saved == run.step:
            return
        uv_map = run.uv_map_srgb()
        self._preview.show(uv_map, run.last_image)
        self._history.preview(run.step, uv_map, run.last_image)
        self._history.flush()  # first: a resumed run cuts the history to its checkpoint, never extends it
        save_checkpoint(self._out / CHECKPOINTS, run.checkpoint())
        self._saved = run.step

    def close(self) -> None:
        if self._history is not None:
            self._history.close()


def _write_result(
    out: Path, vehicle: Vehicle, pyramid: Pyramid, texture: Texture, settings: OptimizerSettings, detector: str
) -> Path:
    """Write ``camouflage.json`` and ``.png`` into ``out``; losses are means over the last steps of the history.

    Raises:
        RaucaError: a history without a step, or damaged.
    """
    last = read_history(out)[-AVERAGED_STEPS:]
    if not last:
        raise RaucaError(f"{out / HISTORY}: holds no step of the run; bring it back, or start anew in another folder")
    made: dict[str, Any] = {
        "detector": detector,
        "steps": settings.steps,
        "seed": settings.seed,
        "final_losses": {name: sum(r[name] for r in last) / len(last) for name in CURVES},
        "settings": settings.identity(),
    }
    if isinstance(texture, NaturalColors):
        uv_map, made["natural"] = finish(texture.constraints, texture.texels())
        png = png_bytes(uv_map)
    else:
        png = map_png(pyramid, texture.texels())
    camouflage = Camouflage(settings.name, vehicle.name, vehicle.atlas_id, settings.map_size, settings.method, made)
    path = out / "camouflage.json"
    save_camouflage(path, camouflage, png)
    return path
