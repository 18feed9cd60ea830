"""Give the vehicle's paint a UV layer of its own, in another process: xatlas lets nothing else in its own one run."""

from __future__ import annotations

import shutil
from collections.abc import Generator

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...core import child_process, contract
from ...folders import job_folder
from ...jobs.child import child_command, ending
from ...scene.images import read_image_blender
from ...scene.mesh_edits import object_mode
from ...scene.paint_layer import to_unwrap, write_unwrapped
from ...scene.uvs import unwrapped
from ...scene.vehicle import untouched_shipped
from ...scene.vehicle_reading import Reading
from ..operator import NOT_PICKED, ModalOperator, Obstacle


class UnwrapChild:
    """A vehicle being unwrapped; :meth:`stop` it in the end."""

    def __init__(self, vehicle: contract.Vehicle) -> None:
        """Start; raises :class:`RaucaError` when the program cannot be started or there is no room."""
        self.folder = job_folder()
        try:
            vehicle.save(self.folder / "before")
            job = self.folder / "job.json"
            contract.save_job(job, contract.UnwrapVehicle(self.folder / "before", self.folder / "after"))
            self._process = child_process.ChildProcess(child_command(job))
            self._process.listen(lambda line: None)
        except (OSError, contract.RaucaError) as error:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise contract.RaucaError(f"Unwrapping cannot start: {error}") from None

    def is_alive(self) -> bool:
        return self._process.code() is None

    def result(self) -> contract.Vehicle:
        """The vehicle with its new atlas; its last note tells how it was made.

        Raises:
            RaucaError: it cannot be unwrapped, or the process died.
        """
        if code := self._process.code():
            raise contract.RaucaError(ending(code, self._process.complaints()))
        return contract.load_vehicle(self.folder / "after", read_image_blender)

    def stop(self) -> None:
        """End it, if it still works, and remove its files."""
        self._process.kill()
        shutil.rmtree(self.folder, ignore_errors=True)


class RAUCA_OT_unwrap_paint(ModalOperator, bpy.types.Operator):
    """Unwrap the paint into a UV layer of its own, without overlaps and at one level of detail; other layers stay"""

    bl_label = "Unwrap"
    stopped = "Unwrapping stopped"
    obstacles = (
        Obstacle("The paint is being unwrapped; Esc stops it", lambda _: RAUCA_OT_unwrap_paint.running() is not None),
        NOT_PICKED,
    )

    def begin(self, context: bpy.types.Context) -> UnwrapChild:
        with object_mode(context):
            return UnwrapChild(to_unwrap(_reading(context)))

    def work(self, context: bpy.types.Context) -> None:
        """Without a window: unwrap here and now."""
        with object_mode(context):
            self._write(context, *unwrapped(to_unwrap(_reading(context))))

    def finish(self, context: bpy.types.Context, child: UnwrapChild) -> Generator[None]:
        yield from ()  # all in one step
        fresh = child.result()
        with object_mode(context):
            self._write(context, fresh, fresh.notes[-1])

    def _write(self, context: bpy.types.Context, fresh: contract.Vehicle, how: str) -> None:
        charts = write_unwrapped(_reading(context), fresh)
        context.scene.rauca.vehicle.checked = False
        told = rpt("Paint unwrapped into {count} charts").format(count=charts) + how
        self.report({"WARNING" if how else "INFO"}, told)


def _reading(context: bpy.types.Context) -> Reading:
    """The chosen vehicle; raises :class:`RaucaError` for one that needs no unwrapping too."""
    settings = context.scene.rauca.vehicle
    if shipped := untouched_shipped(settings.required_objects(context), settings.request()):
        raise contract.RaucaError(f"{shipped.name}: has the UV map that its camouflages fit; no need to unwrap")
    return settings.reading(context)
