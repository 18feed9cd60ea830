"""What the buttons of the photograph do: look at it, fit its camera, show the camouflage in it, leave it.

Fitting and composing are rauca's own commands in the Python of step 5. The folder that is chosen gets ``points.json``
or ``camera.json``, the data set ``fitted`` of this one picture, and in ``worn`` its copies in camouflages.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_rpt as rpt

from ...core import contract, files, schema
from ...folders import chosen_folder, job_folder, refuse_foreign
from ...jobs import watch
from ...jobs.background import Job, Task
from ...preferences import lacks_python, preferences
from ...scene import camera
from ..camouflage.painted_vehicle import objects_of
from ..camouflage.shown_evaluation import take_pictures
from ..job_panel import shown_job
from ..on_disk import ask, camouflage_at, chosen_path, forget
from ..operator import LINKED, BackgroundOperator, Obstacle, RaucaOperator, covered, see_through_camera
from .properties import NO_PHOTOGRAPH, NOT_STANDING, SEE_BOTH, standing

JOB = "photograph"
MARK = "photograph.json"  # in a folder that this panel writes to
FITTED, WORN = "fitted", "worn"
FEWEST = 6  # marks, as the command asks for
LABEL = "shown"  # of the camouflage, in the names of the files that the command writes
NOT_LOOKING = Obstacle("Look at the photograph first", lambda context: context.scene.rauca.photograph.camera is None)


class RAUCA_OT_look_at_photograph(RaucaOperator, bpy.types.Operator):
    """See the photograph before the vehicle, through a camera of its own; your own camera is kept"""

    bl_label = "Look at Photograph"
    obstacles = (LINKED, NO_PHOTOGRAPH, NOT_STANDING, covered("photograph"))

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.photograph
        if settings.camera is not None:
            seen = settings.present(context)
        elif is_fitted(context):
            seen = fitted_camera(chosen_path(settings.folder))
        else:
            seen = settings.first_look()
        settings.look(context, seen)
        settings.lay(settings.path(), SEE_BOTH)
        see_through_camera(context, True)


class RAUCA_OT_leave_photograph(RaucaOperator, bpy.types.Operator):
    """Bring back your own view, camera and picture size; the photograph and its camera go"""

    bl_label = "Leave View"
    obstacles = (Obstacle("No view is being looked through", NOT_LOOKING.stands), covered("photograph"))

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.photograph
        see_through_camera(context, False)  # while there is a camera to look through
        if context.space_data is not None and context.space_data.type == "VIEW_3D":
            context.space_data.lock_camera = False  # what pulled this camera would pull the user's own next
        pictures = take_pictures(settings.camera.data)
        camera.leave(context.scene, settings)
        bpy.data.batch_remove([image for image in pictures if image.users == 0])


def missing(context: bpy.types.Context) -> str:
    """What to do before the photograph can be fitted; empty when all is there."""
    settings = context.scene.rauca.photograph
    for obstacle in (NO_PHOTOGRAPH, NOT_STANDING, NOT_LOOKING):
        if obstacle.stands(context):
            return iface(obstacle.words)
    if 0 < len(settings.marks) < FEWEST:
        words = iface("{count} of at least {fewest} points are marked; or remove them, and pull the view into place")
        return words.format(count=len(settings.marks), fewest=FEWEST)
    # Last: looking and marking need no Python.
    return lacks_python(context) if settings.folder else iface("Choose a folder for the photograph")


class RAUCA_OT_fit_photograph(BackgroundOperator, bpy.types.Operator):
    """Find the photograph's camera by the marked points, or take it as you pulled it, and estimate the light on the paint"""  # noqa: E501

    bl_label = "Fit"
    job = JOB
    running = "The photograph is being worked on; wait, or stop it"
    missing = staticmethod(missing)

    def begin(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.photograph
        folder, image = chosen_folder(settings.folder, rpt("the photograph")), settings.path()
        refuse_foreign(folder, MARK, rpt("fitted photograph"))
        width, height = settings.size()
        vehicle = context.scene.rauca.vehicle.chosen(context)
        if not objects_of(context, vehicle):  # another file was chosen since
            raise contract.RaucaError(NOT_STANDING.words)
        told = {"picture": image.name, "width": width, "height": height, "atlas": vehicle.atlas_id}
        files.write_json(folder / MARK, told)
        for begun in (FITTED, WORN):  # of an earlier fit
            shutil.rmtree(folder / begun, ignore_errors=True)
        for given_before in ("points.json", "camera.json"):
            (folder / given_before).unlink(missing_ok=True)
        if settings.marks:
            given = ["--points", str(_write_points(context, folder))]
        else:
            files.write_json(folder / "camera.json", settings.present(context).to_json())
            given = ["--camera", str(folder / "camera.json")]
        if settings.mask:
            given += ["--mask", bpy.path.abspath(settings.mask)]
        settings.missed_px = -1.0
        words = ["picture", "add", str(image), *given, "--out", str(folder / FITTED)]
        _start(context, folder, words, _show_fit, vehicle)


def _start(
    context: bpy.types.Context, folder: Path, words: list[str], show: Callable[[Job], None],
    vehicle: contract.Vehicle | None = None,
) -> None:  # fmt: skip
    """Run a command of rauca in the Python of step 5; raises :class:`RaucaError` when it cannot be started."""
    settled, scratch = preferences(context), job_folder()
    assert settled is not None  # poll
    try:
        if vehicle is not None:
            vehicle.save(scratch / "vehicle")
            words = [*words, "--vehicle", str(scratch / "vehicle")]
        watch.begin(JOB, Task(folder, [str(settled.program()), "-P", "-m", "pipelines", *words], scratch), show)
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise


def _write_points(context: bpy.types.Context, folder: Path) -> Path:
    """The marks as `rauca picture add` reads them."""
    rows = [
        {"name": f"point {number}", "vehicle_m": point.tolist(), "pixel": pixel.tolist()}
        for number, (point, pixel) in enumerate(zip(*context.scene.rauca.photograph.marked(), strict=True), 1)
    ]
    files.write_json(folder / "points.json", {"format": "rauca-points", "version": 1, "points": rows})
    return folder / "points.json"


def fitted_camera(folder: Path) -> contract.Camera:
    """The camera of the fitted photograph in the vehicle's own frame; raises :class:`RaucaError` if there is none.

    The frame is square, between grey bars; this is the photograph's own camera.
    """
    frame, told = _fitted_frame(folder), schema.read_json(folder / MARK)
    width, height = told.integer("width"), told.integer("height")
    seen = frame.camera_in_vehicle
    K, side = seen.K.copy(), max(width, height)
    K[:2, 2] -= (side - width) // 2, (side - height) // 2
    return contract.Camera(K, seen.R, seen.t, width, height)


def _fitted_frame(folder: Path) -> contract.Frame:
    frames = contract.Dataset(folder / FITTED).frames()
    if not frames:
        raise contract.RaucaError("The photograph is not fitted yet; press Fit")
    return frames[-1]


def _here(job: Job) -> bpy.types.Scene | None:
    """The open scene, if the finished job is its photograph's and that is still looked at."""
    scene = bpy.context.scene
    if job.phase != "done" or scene is None or shown_job(JOB, scene.rauca.photograph.folder) is None:
        return None
    looked_at = scene.rauca.photograph.camera is not None and standing(bpy.context) is not None
    return scene if looked_at else None


def _show_fit(job: Job) -> None:
    """Look through the camera that was found, as a step of undo."""
    forget()
    if (scene := _here(job)) is None:
        return
    settings, found = scene.rauca.photograph, fitted_camera(job.task.folder)
    settings.look(bpy.context, found)
    if settings.marks:
        points, pixels = settings.marked()
        settings.missed_px = float(np.sqrt(((found.project(points)[0] - pixels) ** 2).sum(1).mean()))
    _push("Rauca: Photograph Fitted")


def _push(message: str) -> None:
    if bpy.ops.ed.undo_push.poll():
        bpy.ops.ed.undo_push(message=message)


def is_fitted(context: bpy.types.Context) -> bool:
    """Whether the chosen folder holds the chosen photograph, fitted."""
    settings = context.scene.rauca.photograph
    files_asked = (MARK, f"{FITTED}/dataset.json")
    return (
        bool(settings.file) and ask("photograph", settings.folder, files_asked, _picture_name) == settings.path().name
    )


def _picture_name(folder: Path) -> str | None:
    return schema.read_json(folder / MARK).text("picture") if (folder / FITTED / "dataset.json").is_file() else None


def missing_to_wear(context: bpy.types.Context) -> str:
    """What to do before the camouflage can be shown in the photograph; empty when all is there."""
    if lack := lacks_python(context):
        return lack
    if NOT_LOOKING.stands(context):
        return iface(NOT_LOOKING.words)
    if not is_fitted(context):
        return iface("Fit the photograph first")
    if camouflage_at(context.scene.rauca.camouflage.file) is None:
        return iface("Choose a camouflage in step 6")
    return ""


class RAUCA_OT_wear_photograph(BackgroundOperator, bpy.types.Operator):
    """Show the photograph with the camouflage of step 6 on the vehicle's paint, in the photograph's own light"""

    bl_label = "Show Camouflage"
    job = JOB
    running = RAUCA_OT_fit_photograph.running
    missing = staticmethod(missing_to_wear)

    def begin(self, context: bpy.types.Context) -> None:
        folder = chosen_folder(context.scene.rauca.photograph.folder, rpt("the photograph"))
        path = chosen_path(context.scene.rauca.camouflage.file).with_suffix(".json")
        made = contract.load_camouflage(path)[0]
        made.check_fits(schema.read_json(folder / MARK).text("atlas"), str(path))
        words = ["dataset", "export", str(folder / FITTED), "--format", "coco", "--out", str(folder / WORN)]
        _start(context, folder, [*words, "--camouflage", f"{LABEL}={path}"], _show_worn)


def worn_picture(folder: Path) -> Path:
    """The fitted photograph in the camouflage; raises :class:`RaucaError` if it is not fitted."""
    return folder / WORN / "images" / f"{_fitted_frame(folder).id}--{LABEL}.png"


def _show_worn(job: Job) -> None:
    """Lay the photograph in the camouflage over the view, as a step of undo."""
    if (scene := _here(job)) is not None:
        scene.rauca.photograph.lay(worn_picture(job.task.folder), 1.0)
        _push("Rauca: Camouflage in the Photograph")
