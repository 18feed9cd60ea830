"""Making a data set: the plan from the job, the supervisor's run, and a worker's part in it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from .. import devices
from ..core import contract, files, folder_lock, system
from ..folders import scratch_folder, sweep_scratch
from ..scene.frame import render_chunk
from ..scene.images import read_image_blender
from ..scene.session import Session
from ..scene.vehicle_files import find_vehicle
from .child import child_command
from .supervisor import Crew, Listener, Supervisor
from .workers import News, serve, tell

PATIENCE_S = 5.0  # another shard that looks around holds all cameras for an instant
BYTES_PER_PIXEL = 24  # of a finished frame, generously


def make(job: contract.MakeDataset, progress: Callable[[contract.Progress], None]) -> None:
    """Render what a data set folder, or a shard of it, lacks.

    Raises:
        RaucaError: a mistake in the job, another run on the same frames, or frames that were left out.
    """
    vehicle = find_vehicle(job.vehicle)
    if job.device == "auto" and (job.out / "dataset.json").is_file():  # goes on with what it was begun on
        job = replace(job, device="cpu" if contract.read_plan(job.out).device == "cpu" else "gpu")
    job = replace(job, plan=completed(job, vehicle))
    job.wanted()  # tells a stranger among the frames before anything is written
    for note in [*vehicle.notes, *job.notes]:
        _note(note)
    sweep_scratch()
    with scratch_folder() as scratch, _drafted(job.out, job.plan, vehicle, scratch) as draft:
        reasons = _Run(job, vehicle, draft, scratch / "worker.json", progress).finish()
    if reasons:
        frame, reason = next(iter(reasons.items()))
        raise contract.RaucaError(
            f"{job.out}: {len(reasons)} frames failed twice and were left out, among them {frame}: {reason}; "
            "run the same command with --retry-quarantined to try them again"
        )


def work(job: contract.RenderFrames) -> None:
    """A worker's life: build the scene, then render what standard input asks for."""
    plan = contract.read_plan(job.plan)
    session = Session(plan, contract.load_vehicle(job.plan / "vehicle", read_image_blender), job.scene)
    devices.use(session.scene, job.device, job.threads)
    for note in session.place.notes:
        tell(News("note", reason=note))
    tasks = {task.id: task for task in contract.planned_frames(plan)}

    def render(ids: Sequence[str], tell: Callable[[News], None], stopped: Callable[[], bool]) -> None:
        render_chunk(session, job.out, [tasks[frame_id] for frame_id in ids], tell, stopped)

    # Unbuffered and left open: a thread waits in it to the end, and would hold a buffer's lock.
    serve(render, open(0, "rb", buffering=0, closefd=False))  # noqa: SIM115


def completed(job: contract.MakeDataset, vehicle: contract.Vehicle) -> contract.Plan:
    """The job's plan with what is known here only: vehicle, scene, Blender's version and the device.

    Raises:
        RaucaError: the plan is of another vehicle or scene, or there is no such device.
    """
    plan = job.plan
    if plan.atlas_id not in ("", vehicle.atlas_id):
        raise contract.RaucaError(
            f"{vehicle.name}: the plan is of {plan.vehicle_name or 'a vehicle'} in another UV layout; "
            "give its vehicle with --vehicle"
        )
    scenery = contract.Scenery.of_file(job.scene) if job.scene else contract.Scenery()
    if plan.scenery not in (contract.Scenery(), scenery):
        raise contract.RaucaError(f"{job.out}: the plan is of the scene {plan.scenery.name}; give it with --scene")
    return replace(
        plan,
        name=job.out.name,
        vehicle_name=vehicle.name,
        atlas_id=vehicle.atlas_id,
        blender=bpy.app.version_string,
        scenery=scenery,
        device=devices.find(job.device).described,
    )


@dataclass(frozen=True)
class _Run:
    """One supervised run over a shard; workers read plan and vehicle from ``draft`` and their job from ``order``."""

    job: contract.MakeDataset
    vehicle: contract.Vehicle
    draft: Path
    order: Path
    progress: Callable[[contract.Progress], None]

    def finish(self) -> dict[str, str]:
        """Render what is missing; returns the shard's quarantined frames with their reasons."""
        out, shard, plan = self.job.out, self.job.shard, self.job.plan
        with hold_cameras(out, plan, shard) as held:
            sweep(out, held)
            if (out / "dataset.json").is_file():
                self._claim(held)  # a vehicle removed as damaged comes back where no frame is missing, too
            asked = self.job.wanted()
            wanted, left_out = self._survey(asked)
            files.require_space(out, plan.size**2 * BYTES_PER_PIXEL * len(wanted))
            listener = Listener(self.progress, _note)
            supervisor = Supervisor(out, shard, self._crew(), listener, lambda: self._claim(held))
            try:
                supervisor.run(self._pieces(wanted), len(asked) - len(wanted))
            finally:
                sweep(out, held)
            return left_out | supervisor.quarantined

    def _survey(self, asked: list[contract.PlannedFrame]) -> tuple[list[contract.PlannedFrame], dict[str, str]]:
        """Frames to render, and those left out as quarantined; the ledger learns of done frames that it misses."""
        out, again = self.job.out, self.job.retry_quarantined
        ledger, states = contract.read_ledger(out), contract.frame_states(out)
        wanted, left_out = [], {}
        for frame in asked:
            state = states.get(frame.id)
            if state == "quarantined" and not again:
                left_out[frame.id] = ledger[frame.id].reason or ""
            elif state not in ("done", "occluded"):
                wanted.append(frame)
            elif state == "done" and (frame.id not in ledger or ledger[frame.id].state != "done"):
                # killed between the frame's rename and the ledger's line; when tried again, that still says otherwise
                contract.append_entry(out, contract.LedgerEntry(frame.id, "done"), self.job.shard.label)
        return wanted, left_out

    def _pieces(self, wanted: list[contract.PlannedFrame]) -> list[list[str]]:
        """With several workers, pieces small enough that all of them are busy to the end."""
        workers, most = self.job.workers, self.job.recycle
        if workers > 1:
            most = min(most, max(len(self.job.plan.weathers), len(wanted) // (4 * workers)))
        return [[frame.id for frame in chunk] for chunk in contract.chunks(self.job.plan, wanted, most)]

    def _crew(self) -> Crew:
        job, threads = self.job, 0
        if job.workers > 1:  # together they fill the machine
            threads = max(1, system.cores() // job.workers)
        order = contract.RenderFrames(
            self.draft.absolute(), job.out.absolute(), job.scene and job.scene.absolute(), threads, job.device
        )
        contract.save_job(self.order, order)
        return Crew(child_command(self.order, threads), job.workers, job.recycle)

    def _claim(self, held: folder_lock.HeldRange) -> None:
        """Write vehicle and plan where they are missing; the first time, once a worker could build the scene."""
        with held.shared_writing():
            # Without a plan, nothing says that a vehicle which lies there is the one that is rendered.
            if not all((self.job.out / name).is_file() for name in ("dataset.json", "vehicle/vehicle.json")):
                self.vehicle.save(self.job.out / "vehicle")
            elif self.draft != self.job.out:  # another shard's, written since
                _require_same(self.job.out, self.vehicle)
            contract.claim_folder(self.job.out, self.job.plan)
            contract.seal_dataset(self.job.out)


@contextlib.contextmanager
def hold_cameras(out: Path, plan: contract.Plan, shard: contract.Shard) -> Iterator[folder_lock.HeldRange]:
    """Lock a shard's cameras: shards that do not overlap may share a folder, anything else is refused.

    Raises:
        RaucaError: another process renders some of them; the message names it.
    """
    label = f"shard {shard}" if shard.count > 1 else ""
    refusal = "is being rendered by {who}; wait for it, stop it, or take a shard that does not overlap"
    cameras = contract.cameras_of(plan, shard)
    with folder_lock.hold_range(out, *cameras, label, refusal, patience_s=PATIENCE_S) as held:
        yield held


def sweep(out: Path, held: folder_lock.HeldRange) -> None:
    """Remove what killed jobs left half-written, unless another shard is at work and may be writing it."""
    with held.nobody_else() as alone:
        if alone:
            with held.shared_writing():  # a shard that has no camera to lock may be writing the vehicle
                files.sweep_partials(out)
            files.sweep_partials(out / "frames")


@contextlib.contextmanager
def _drafted(out: Path, plan: contract.Plan, vehicle: contract.Vehicle, draft: Path) -> Iterator[Path]:
    """The folder from which workers read plan and vehicle: ``out`` if it has them, else ``draft``, outside it.

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
