"""Look at the vehicle as detectors did."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...core import contract
from ...scene import camera
from ..operator import RaucaOperator, tooltip
from .evaluation import EvaluatedFrame, Views, camera_in_world
from .shown_evaluation import load_now, nearest, same_view, vehicle_to_world

CAMERA_NAME = "rauca evaluated view"
STEPS = [
    ("NEAREST", "Nearest", "The evaluated view closest to the present camera"),
    ("NEXT", "Next", "The next evaluated view"),
    ("PREVIOUS", "Previous", "The evaluated view before"),
    ("WEATHER", "Weather", "The same view in the next weather"),
]


class RAUCA_OT_evaluated_view(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Look at the vehicle through a view that detectors were evaluated on; a camera of its own is added for that"""

    bl_idname = "rauca.evaluated_view"
    bl_label = "Look Through an Evaluated View"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    step: bpy.props.EnumProperty(name="View", items=STEPS, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: RAUCA_OT_evaluated_view) -> str:
        return tooltip(STEPS, properties.step)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.camouflage
        if settings.coat is None:
            return rpt("Apply a camouflage first")
        return rpt("Choose the folder of an evaluation first") if not settings.study else ""

    def work(self, context: bpy.types.Context) -> None:
        scene = context.scene
        views = load_now(scene.rauca.camouflage.study)
        pose = vehicle_to_world(scene)
        evaluated = _chosen(scene, views, self.step)
        if evaluated is None or pose is None:
            raise contract.RaucaError("The vehicle is no longer in this scene; apply the camouflage again (step 6)")
        if scene.camera is None or scene.camera.name != CAMERA_NAME:
            scene.camera = _own_camera(scene)
        camera.place(scene, camera_in_world(evaluated.camera, pose))
        scene.rauca.camouflage.frame = evaluated.frame
        if context.space_data is not None and context.space_data.type == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"


def _chosen(scene: bpy.types.Scene, views: Views, step: str) -> EvaluatedFrame | None:
    here = same_view(scene, views)
    if not here or step == "NEAREST":
        return here[0] if here else nearest(scene, views)
    if step == "WEATHER":
        order = [evaluated for evaluated in views.evaluated_frames if evaluated in here]
        return order[(order.index(here[0]) + 1) % len(order)]
    # One frame of each view: of frames whose cameras agree, the first.
    first: list[EvaluatedFrame] = []
    for evaluated in views.evaluated_frames:
        if not any((abs(evaluated.camera.position - other.camera.position) < 1e-6).all() for other in first):
            first.append(evaluated)
    mine = next(i for i, s in enumerate(first) if (abs(s.camera.position - here[0].camera.position) < 1e-6).all())
    return first[(mine + (1 if step == "NEXT" else -1)) % len(first)]


def _own_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    known = scene.objects.get(CAMERA_NAME)
    if known is not None and known.type == "CAMERA":
        return known
    thing = bpy.data.objects.new(CAMERA_NAME, bpy.data.cameras.new(CAMERA_NAME))
    scene.collection.objects.link(thing)
    return thing


CLASSES = (RAUCA_OT_evaluated_view,)
