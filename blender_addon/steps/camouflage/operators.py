"""What the buttons of step 6 do."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from mathutils import Matrix

from ...core import contract
from ...scene import camera
from ...scene.camouflages import read_paintwork
from ...scene.coating import Coat, paint_surface, painted_objects, uncoat
from ...scene.mesh_edits import Surface, object_mode
from ..operator import NO_COAT, Obstacle, RaucaOperator, covered, see_through_camera
from .evaluation import EvaluatedFrame, Views, find_evaluation
from .painted_vehicle import objects_of, place, vehicle_for
from .shown_evaluation import load_now, nearest, paint_of, same_view, show_picture, take_pictures, vehicle_to_world


class RAUCA_OT_apply_camouflage(RaucaOperator, bpy.types.Operator):
    """Paint the vehicle of step 1 with the chosen camouflage; it is added to the scene if it is not there"""

    bl_label = "Apply Camouflage"

    def work(self, context: bpy.types.Context) -> str:
        return wear(context)


def wear(context: bpy.types.Context) -> str:
    """Paint the vehicle of step 1 with the camouflage chosen in step 6; returns what to tell.

    Raises:
        RaucaError: none is chosen, it does not fit, or the vehicle cannot be painted; nothing was changed.
    """
    settings = context.scene.rauca.camouflage
    if not settings.file:
        raise contract.RaucaError("No camouflage: choose its .json or .png file in step 6")
    path = Path(bpy.path.abspath(settings.file))
    with object_mode(context):
        vehicle = vehicle_for(context, path)
        paintwork = read_paintwork(path.with_suffix(".json"), vehicle.atlas_id)
        objects = objects_of(context, vehicle)
        surface = Surface.of(vehicle, objects or place(context, vehicle))
        coat = paint_surface(surface, paintwork)
    settings.coat = coat.tree
    anchor = surface.painted_pieces()[0].owner
    settings.anchor = anchor
    to_anchor = np.linalg.inv(np.array(anchor.matrix_world)) @ surface.vehicle_to_world()
    settings.vehicle_to_anchor = [x for row in Matrix(to_anchor.tolist()) for x in row]
    settings.study = settings.study or find_evaluation(path)
    return rpt("{name} is on {vehicle}").format(name=paintwork.name, vehicle=vehicle.name)


LOOKS = [
    ("TOGGLE", "Toggle", "The original paint if the camouflage shows, else the camouflage"),
    ("ORIGINAL", "Original", "The vehicle's own paint"),
    ("CAMOUFLAGE", "Camouflage", "The camouflage, in the UV layer that it was made for"),
    ("BAKED", "Baked", "The baked image, in its own UV layer"),
]


class RAUCA_OT_show_paint(RaucaOperator, bpy.types.Operator):
    """Change between the original paint and the camouflage"""

    bl_label = "Original / Camouflage"
    which: bpy.props.EnumProperty(name="Show", items=LOOKS, options={"SKIP_SAVE"})
    obstacles = (NO_COAT,)

    def work(self, context: bpy.types.Context) -> None:
        coat = Coat(context.scene.rauca.camouflage.coat)
        which = self.which
        if which == "TOGGLE":
            which = "CAMOUFLAGE" if coat.shown == "ORIGINAL" else "ORIGINAL"
        if which == "BAKED" and coat.image("baked") is None:
            raise contract.RaucaError("Nothing is baked yet; bake the camouflage first (step 8)")
        coat.show(which)
        show_picture(context.scene)


class RAUCA_OT_remove_camouflage(RaucaOperator, bpy.types.Operator):
    """Take the camouflage off again: the materials are as they were"""

    bl_label = "Remove Camouflage"
    obstacles = (Obstacle("There is no camouflage to remove", NO_COAT.stands),)

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.camouflage
        with object_mode(context):
            uncoat(painted_objects(context.scene, Coat(settings.coat)))
        settings.coat = None


STEPS = [
    ("NEAREST", "Nearest", "The evaluated view closest to the present camera"),
    ("NEXT", "Next", "The next evaluated view"),
    ("PREVIOUS", "Previous", "The evaluated view before"),
    (
        "WORST",
        "Worst",
        "The view in which detectors are surest of the vehicle in this paint; again: the next",
    ),
    ("WEATHER", "Weather", "The same view in the next weather"),
]


class RAUCA_OT_evaluated_view(RaucaOperator, bpy.types.Operator):
    """Look at the vehicle through a view that detectors were evaluated on; a camera of its own is added for that"""

    bl_label = "Look Through an Evaluated View"
    step: bpy.props.EnumProperty(name="View", items=STEPS, options={"SKIP_SAVE"})
    obstacles = (
        NO_COAT,
        Obstacle("Choose the folder of an evaluation first", lambda context: not context.scene.rauca.camouflage.study),
        covered("camouflage"),
    )

    def work(self, context: bpy.types.Context) -> None:
        scene = context.scene
        views = load_now(scene.rauca.camouflage.study)
        pose = vehicle_to_world(scene)
        evaluated = _chosen(scene, views, self.step)
        if evaluated is None or pose is None:
            raise contract.RaucaError("The vehicle is no longer in this scene; apply the camouflage again (step 6)")
        settings = scene.rauca.camouflage
        camera.look(scene, settings, evaluated.camera.relative_to(np.linalg.inv(pose)))
        settings.frame = evaluated.frame
        context.view_layer.update()  # the picture is found by where the camera stands
        show_picture(scene)
        see_through_camera(context, True)


def _chosen(scene: bpy.types.Scene, views: Views, step: str) -> EvaluatedFrame | None:
    if step == "WORST":
        return _worst(scene, views)
    here = same_view(scene, views)
    if not here or step == "NEAREST":
        return here[0] if here else nearest(scene, views)
    if step == "WEATHER":
        order = [evaluated for evaluated in views.evaluated_frames if evaluated in here]
        return order[(order.index(here[0]) + 1) % len(order)]
    # One frame of each view: of frames whose cameras agree, the first.
    first: dict[tuple[float, ...], EvaluatedFrame] = {}
    for evaluated in views.evaluated_frames:
        first.setdefault(_place(evaluated), evaluated)
    mine = list(first).index(_place(here[0]))
    return list(first.values())[(mine + (1 if step == "NEXT" else -1)) % len(first)]


def _worst(scene: bpy.types.Scene, views: Views) -> EvaluatedFrame | None:
    """The surest found view, or the one after it in that order where it is looked through already."""
    paint, here = paint_of(scene), [evaluated.frame for evaluated in same_view(scene, views)[:1]]
    order = [evaluated for evaluated in views.evaluated_frames if paint in evaluated.evaluation.paints]
    order.sort(key=lambda evaluated: -evaluated.sureness(paint))
    at = next((i for i, evaluated in enumerate(order) if [evaluated.frame] == here), None)
    return order[0 if at is None else (at + 1) % len(order)] if order else nearest(scene, views)


def _place(evaluated: EvaluatedFrame) -> tuple[float, ...]:
    """Where its camera stands, to a millionth of a metre."""
    return tuple(evaluated.camera.position.round(6).tolist())


class RAUCA_OT_leave_evaluated_view(RaucaOperator, bpy.types.Operator):
    """Bring back your own view, camera and picture size; the evaluated view's camera and picture go"""

    bl_label = "Leave View"
    obstacles = (
        Obstacle("No view is being looked through", lambda context: context.scene.rauca.camouflage.camera is None),
        covered("camouflage"),
    )

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.camouflage
        see_through_camera(context, False)  # while there is a camera to look through
        pictures = take_pictures(settings.camera.data)
        camera.leave(context.scene, settings)
        bpy.data.batch_remove([image for image in pictures if image.users == 0])
