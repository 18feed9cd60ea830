"""Give the vehicle's paint a UV layer of its own, in another process: xatlas lets nothing else in its own one run."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...child import child_command
from ...core import child_process, contract
from ...folders import job_folder
from ...jobs.endings import ending
from ...scene.images import read_image_blender
from ...scene.mesh_edits import object_mode
from ...scene.paint_layer import to_unwrap, write_unwrapped
from ...scene.uvs import unwrapped
from ...scene.vehicle import untouched_shipped
from ...scene.vehicle_reading import Reading
from ..operator import RaucaOperator


class UnwrapChild:
    """A vehicle being unwrapped; :meth:`close` it in the end."""

    def __init__(self, vehicle: contract.Vehicle) -> None:
        """Start; raises :class:`RaucaError` when the program cannot be started or there is no room."""
        self._folder: Path = job_folder()
        try:
            vehicle.save(self._folder / "before")
            job = self._folder / "job.json"
            contract.save_job(job, contract.UnwrapVehicle(self._folder / "before", self._folder / "after"))
            self._process = child_process.ChildProcess(child_command(job))
            self._process.listen(lambda line: None)
        except (OSError, contract.RaucaError) as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise contract.RaucaError(f"Unwrapping cannot start: {error}") from None

    def ended(self) -> bool:
        """Whether :meth:`result` is there."""
        return self._process.code() is not None

    def result(self) -> contract.Vehicle:
        """The vehicle with its new atlas; its last note tells how it was made.

        Raises:
            RaucaError: it cannot be unwrapped, or the process died.
        """
        if code := self._process.code():
            how = ending(code, self._process.complaints())
            raise contract.RaucaError(how.text.format(**how.values))
        return contract.load_vehicle(self._folder / "after", read_image_blender)

    def close(self) -> None:
        """End it, if it still works, and remove its files."""
        self._process.kill()
        shutil.rmtree(self._folder, ignore_errors=True)


INTERVAL_S = 0.1

_child: UnwrapChild | None = None


def unwrapping() -> bool:
    """Whether a vehicle is being unwrapped beside the window."""
    return _child is not None


class RAUCA_OT_unwrap_paint(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Unwrap the paint into a UV layer of its own, without overlaps and at one level of detail; other layers stay"""

    bl_idname = "rauca.unwrap_paint"
    bl_label = "Unwrap"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if unwrapping():
            return rpt("The paint is being unwrapped; Esc stops it")
        if context.scene.rauca.vehicle.picked(context) is None:
            return rpt("Pick the vehicle's object or collection first")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        """Without a window: unwrap here and now."""
        with object_mode(context):
            reading = _reading(context)
            fresh, how = unwrapped(to_unwrap(reading))
            self._write(context, reading, fresh, how)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        global _child
        try:
            with object_mode(context):
                _child = UnwrapChild(to_unwrap(_reading(context)))
        except contract.RaucaError as error:
            return self.refuse(error)
        self._timer = context.window_manager.event_timer_add(INTERVAL_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" or _child is None:
            self.cancel(context)
            self.report({"INFO"}, rpt("Unwrapping stopped"))
            return {"CANCELLED"}
        if event.type != "TIMER" or not _child.ended():
            return {"PASS_THROUGH"}
        try:
            fresh = _child.result()
            with object_mode(context):
                self._write(context, _reading(context), fresh, fresh.notes[-1])
        except contract.RaucaError as error:
            return self.refuse(error)
        finally:
            self.cancel(context)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Also called by Blender, when another file is loaded."""
        stop()
        context.window_manager.event_timer_remove(self._timer)

    def _write(self, context: bpy.types.Context, reading: Reading, fresh: contract.Vehicle, how: str) -> None:
        charts = write_unwrapped(reading, fresh)
        context.scene.rauca.vehicle.forget_check()
        self.report(
            {"WARNING" if how else "INFO"}, rpt("Paint unwrapped into {count} charts").format(count=charts) + how
        )


def _reading(context: bpy.types.Context) -> Reading:
    """The chosen vehicle; raises :class:`RaucaError` for one that needs no unwrapping too."""
    settings = context.scene.rauca.vehicle
    if shipped := untouched_shipped(settings.required_objects(context), settings.request()):
        raise contract.RaucaError(f"{shipped.name}: has the UV map that its camouflages fit; no need to unwrap")
    return settings.reading(context)


def stop() -> None:
    """End what still runs."""
    global _child
    if _child is not None:
        _child.close()
    _child = None


CLASSES = (RAUCA_OT_unwrap_paint,)
