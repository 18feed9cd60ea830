"""Making a data set: the plan from the options, the supervisor's run, and a worker's part in it."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import bpy

from .child import child_command
from .core import assets, contract, files
from .jobs.crew import own_threads
from .jobs.lock import FolderLock, hold_cameras
from .jobs.messages import News
from .jobs.supervisor import Crew, Listener, Supervisor
from .jobs.worker import serve, tell
from .scene.images import read_image_blender
from .scratch import scratch_folder, sweep_scratch
from .selection import chosen_frames
from .vehicles import find_vehicle

BYTES_PER_PIXEL = 24  # of a finished frame, generously


def make(options: argparse.Namespace, progress: Callable[[contract.Progress], None]) -> None:
    """Render what a data set folder, or a shard of it, lacks.

    Raises:
        RaucaError: a mistake in the options, another run on the same frames, or frames that were left out.
    """
    vehicle = find_vehicle(options.vehicle, options.paint_mask, options.paint_material)
    plan = plan_from(options, vehicle)
    plan.check("options")
    for note in [*vehicle.notes, *contract.preset_notes(options.weathers, assets.assets_folder() / "weathers")]:
        _note(note)
    sweep_scratch()
    with _drafted(options.out, plan, vehicle) as draft:
        reasons = _Run(options, plan, vehicle, draft, progress).finish()
    if reasons:
        frame, reason = next(iter(reasons.items()))
        raise contract.RaucaError(
            f"{options.out}: {len(reasons)} frames failed twice and were left out, among them {frame}: {reason}; "
            "run the same command with --retry-quarantined to try them again"
        )


def work(options: argparse.Namespace) -> None:
    """A worker's life: build the scene, then render what standard input asks for."""
    from .scene.dataset import render_chunk
    from .scene.session import Session

    plan = contract.read_plan(options.plan)
    session = Session(plan, contract.load_vehicle(options.plan / "vehicle", read_image_blender), options.scene)
    if options.threads:
        session.scene.render.threads_mode, session.scene.render.threads = "FIXED", options.threads
    for note in session.place.notes:
        tell(News("note", reason=note))
    tasks = {task.id: task for task in contract.planned_frames(plan)}

    def render(ids: Sequence[str], tell: Callable[[News], None], stopped: Callable[[], bool]) -> None:
        render_chunk(session, options.out, [tasks[frame_id] for frame_id in ids], tell, stopped)

    # Unbuffered and left open: a thread waits in it to the end, and would hold a buffer's lock.
    serve(render, open(0, "rb", buffering=0, closefd=False))  # noqa: SIM115


def plan_from(options: argparse.Namespace, vehicle: contract.Vehicle) -> contract.Plan:
    """The plan that ``make_dataset``'s options describe."""
    ring = contract.Ring(
        azimuths_deg=options.azimuths,
        elevations_deg=options.elevations,
        distances_m=options.distances,
        jitter_azimuth_deg=options.jitter_azimuth,
        jitter_elevation_deg=options.jitter_elevation,
        jitter_distance=options.jitter_distance,
        jitter_aim_m=options.jitter_aim,
        jitter_roll_deg=options.jitter_roll,
        fov_deg=options.fov,
    )
    return contract.Plan(
        name=options.out.name,
        vehicle_name=vehicle.name,
        atlas_id=vehicle.atlas_id,
        size=options.size,
        quality=contract.Quality(
            options.samples, options.adaptive_threshold, options.denoise, options.bounces, options.composed_fog
        ),
        light=options.light,
        weathers=tuple(contract.find_preset(options.weathers, assets.assets_folder() / "weathers")),
        ring=ring,
        locations=options.locations,
        reference_srgb=options.reference,
        min_visible=options.min_visible,
        seed=options.seed,
        blender=bpy.app.version_string,
        scenery=contract.Scenery.of_file(options.scene) if options.scene else contract.Scenery(),
        finish=options.finish,
        recolor_share=options.recolor_share,
    )


@dataclass(frozen=True)
class _Run:
    """One supervised run over a shard; workers read plan and vehicle from ``draft``."""

    options: argparse.Namespace
    plan: contract.Plan
    vehicle: contract.Vehicle
    draft: Path
    progress: Callable[[contract.Progress], None]

    def finish(self) -> dict[str, str]:
        """Render what is missing; returns the shard's quarantined frames with their reasons."""
        out, shard = self.options.out, self.options.shard
        with hold_cameras(out, shard, contract.cameras_of(self.plan, shard)) as lock:
            lock.sweep()
            if (out / "dataset.json").is_file():
                self._claim(lock)  # a vehicle removed as damaged comes back where no frame is missing, too
            wanted, left_out = self._survey()
            files.require_space(out, self.plan.size**2 * BYTES_PER_PIXEL * len(wanted))
            listener = Listener(self.progress, _note)
            supervisor = Supervisor(out, shard, self._crew(), listener, lambda: self._claim(lock))
            try:
                supervisor.run(self._pieces(wanted), len(self._asked) - len(wanted))
            finally:
                lock.sweep()
            return left_out | supervisor.quarantined

    @cached_property
    def _asked(self) -> list[contract.PlannedFrame]:
        """The shard's frames, or those of them that ``--only`` or ``--frames`` choose."""
        chosen = chosen_frames(self.plan, self.options)
        return [frame for frame in contract.planned_frames(self.plan, self.options.shard) if frame.id in chosen]

    def _survey(self) -> tuple[list[contract.PlannedFrame], dict[str, str]]:
        """Frames to render, and those left out as quarantined; the ledger learns of done frames that it misses."""
        out, again = self.options.out, self.options.retry_quarantined
        ledger, states = contract.read_ledger(out), contract.frame_states(out)
        wanted, left_out = [], {}
        for frame in self._asked:
            state = states.get(frame.id)
            if state == "quarantined" and not again:
                left_out[frame.id] = ledger[frame.id].reason or ""
            elif state not in ("done", "occluded"):
                wanted.append(frame)
            elif state == "done" and (frame.id not in ledger or ledger[frame.id].state != "done"):
                # killed between the frame's rename and the ledger's line; when tried again, that still says otherwise
                contract.append_entry(out, contract.LedgerEntry(frame.id, "done"), self.options.shard.label)
        return wanted, left_out

    def _pieces(self, wanted: list[contract.PlannedFrame]) -> list[list[str]]:
        """With several workers, pieces small enough that all of them are busy to the end."""
        workers, most = self.options.workers, self.options.recycle
        if workers > 1:
            most = min(most, max(len(self.plan.weathers), len(wanted) // (4 * workers)))
        return [[frame.id for frame in chunk] for chunk in contract.chunks(self.plan, wanted, most)]

    def _crew(self) -> Crew:
        options = self.options
        threads = own_threads(options.workers) if options.workers > 1 else 0
        arguments = ["--plan", str(self.draft.absolute()), "--out", str(options.out.absolute())]
        arguments += ["--scene", str(options.scene.absolute())] if options.scene else []
        command = child_command("dataset_worker", [*arguments, "--threads", str(threads)])
        return Crew(command, options.workers, options.recycle)

    def _claim(self, lock: FolderLock) -> None:
        """Write vehicle and plan where they are missing; the first time, once a worker could build the scene."""
        with lock.claiming():
            # Without a plan, nothing says that a vehicle which lies there is the one that is rendered.
            if not all((self.options.out / name).is_file() for name in ("dataset.json", "vehicle/vehicle.json")):
                self.vehicle.save(self.options.out / "vehicle")
            elif self.draft != self.options.out:  # another shard's, written since
                _require_same(self.options.out, self.vehicle)
            contract.claim_folder(self.options.out, self.plan)
            contract.seal_dataset(self.options.out)


@contextlib.contextmanager
def _drafted(out: Path, plan: contract.Plan, vehicle: contract.Vehicle) -> Iterator[Path]:
    """The folder from which workers read plan and vehicle: ``out`` if it has them, else a draft outside it.

    So a scene that cannot be built leaves no plan behind that the corrected options would clash with.

    Raises:
        RaucaError: ``out`` holds a data set of another plan, or of another vehicle.
    """
    if (out / "dataset.json").is_file():
        contract.claim_folder(out, plan)
        if (out / "vehicle" / "vehicle.json").is_file():  # else it was damaged and removed
            _require_same(out, vehicle)
            yield out
            return
    with scratch_folder() as draft:
        vehicle.save(draft / "vehicle")
        contract.claim_folder(draft, plan)
        yield draft


def _require_same(out: Path, vehicle: contract.Vehicle) -> None:
    """Raise :class:`RaucaError` if the data set's vehicle is another: the plan knows its name and atlas only."""
    changed = contract.load_vehicle(out / "vehicle", read_image_blender).changed(vehicle)
    if changed:
        raise contract.RaucaError(
            f"{out}: holds a data set of another {vehicle.name} (changed: {', '.join(changed)}); choose another folder "
            "or remove it"
        )


def _note(text: str) -> None:
    print(f"note: {text}", flush=True)
