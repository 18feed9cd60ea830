"""A clip between two cameras of the scene: a third one drives from the first to the second on the timeline."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...core import contract
from ...scene.overrides import override, restore
from ...translations import OWN_SENSE
from ..operator import LEAVE_FIRST, LINKED, VIEWS, Obstacle, RaucaOperator, see_through_camera
from ..panel import SidebarPanel, paragraph

MOST_FRAMES = 3000  # each has keyframes of its own


def _is_camera(self: RaucaClip, thing: bpy.types.Object) -> bool:
    return thing.type == "CAMERA" and thing != self.camera


class RaucaClip(bpy.types.PropertyGroup):
    """Where a clip starts and ends, how fast it is driven, and what its preview has put into the scene."""

    start: bpy.props.PointerProperty(
        name="Start", type=bpy.types.Object, poll=_is_camera, description="The camera of this scene to drive from"
    )
    end: bpy.props.PointerProperty(
        name="End", type=bpy.types.Object, poll=_is_camera, description="The camera of this scene to drive to"
    )
    speed: bpy.props.FloatProperty(
        name="Speed", description="How fast the camera drives", default=10.0, min=0.1, max=100.0, unit="VELOCITY"
    )
    frame_rate: bpy.props.FloatProperty(
        name="Frame Rate", description="Pictures a second", default=15.0, min=0.1, max=1000.0, precision=1
    )
    camera: bpy.props.PointerProperty(type=bpy.types.Object)
    camera_before: bpy.props.PointerProperty(type=bpy.types.Object)
    frame_before: bpy.props.IntProperty(options={"HIDDEN"})
    overrides: bpy.props.StringProperty(options={"HIDDEN"})

    @property
    def previewed(self) -> bool:
        return bool(self.overrides)

    @property
    def ready(self) -> bool:
        """Whether there are two cameras to drive between."""
        here = self.id_data.objects
        return all(end is not None and end.name in here for end in (self.start, self.end)) and self.start != self.end

    @property
    def metres(self) -> float:
        """From the start to the end."""
        return float((self.end.matrix_world.translation - self.start.matrix_world.translation).length)

    @property
    def frames(self) -> int:
        """The first stands at the start; the last is the last one before the end or on it."""
        return int(self.metres / self.speed * self.frame_rate + 1e-4) + 1


NO_CAMERAS = Obstacle(
    "Pick two cameras of this scene, to start and to end at", lambda context: not context.scene.rauca.clip.ready
)
LOOKING = Obstacle(
    LEAVE_FIRST, lambda context: any(getattr(context.scene.rauca, step).camera is not None for step in VIEWS)
)


class RAUCA_PT_cameras_clip(SidebarPanel, bpy.types.Panel):
    """Drive from one camera of the scene to another, previewed on the timeline"""

    bl_label = "Clip"
    bl_translation_context = OWN_SENSE
    bl_parent_id = "RAUCA_PT_cameras"

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        clip = context.scene.rauca.clip
        column = layout.column(align=True)
        column.enabled = not clip.previewed
        for name in ("start", "end", "speed", "frame_rate"):
            column.prop(clip, name)
        button = RAUCA_OT_leave_clip if clip.previewed else RAUCA_OT_preview_clip
        layout.operator(button.bl_idname, icon="X" if clip.previewed else "PLAY")
        # Below the button, which keeps its place.
        if reason := button.obstacle(context):
            paragraph(context, layout, reason, icon="INFO")
        else:
            words = iface("{count} frames in {seconds} s over {metres} m").format(
                count=clip.frames, seconds=f"{clip.metres / clip.speed:.1f}", metres=f"{clip.metres:.1f}"
            )
            paragraph(context, layout, words, icon="TIME")


class RAUCA_OT_preview_clip(RaucaOperator, bpy.types.Operator):
    """Let a camera of its own drive on the timeline, with a keyframe in every frame; your own cameras are kept"""

    bl_label = "Preview Clip"
    obstacles = (
        LINKED,
        Obstacle("The clip is previewed already", lambda context: context.scene.rauca.clip.previewed),
        NO_CAMERAS,
        LOOKING,
    )

    def work(self, context: bpy.types.Context) -> None:
        scene, clip = context.scene, context.scene.rauca.clip
        if clip.frames < 2:
            raise contract.RaucaError("A clip needs two frames: lower the speed, or raise the frame rate")
        if clip.frames > MOST_FRAMES:
            raise contract.RaucaError("This clip has more than 3000 frames: raise the speed, or lower the frame rate")
        clip.camera_before, clip.frame_before = scene.camera, scene.frame_current
        clip.camera = _driving(clip, scene.frame_start)
        scene.collection.objects.link(clip.camera)
        scene.camera = clip.camera
        whole = max(round(clip.frame_rate), 1)
        clip.overrides = override(
            scene,
            "",
            {
                "frame_end": scene.frame_start + clip.frames - 1,
                "use_preview_range": False,
                "render.fps": whole,
                "render.fps_base": whole / clip.frame_rate,
            },
        )
        scene.frame_set(scene.frame_start)
        see_through_camera(context, True)


class RAUCA_OT_leave_clip(RaucaOperator, bpy.types.Operator):
    """Bring back your own view, camera and timeline; the clip's camera and its keyframes go"""

    bl_label = "Leave Clip"
    obstacles = (
        Obstacle("No clip is previewed", lambda context: not context.scene.rauca.clip.previewed),
        LOOKING,
    )

    def work(self, context: bpy.types.Context) -> None:
        scene, clip = context.scene, context.scene.rauca.clip
        see_through_camera(context, False)  # while there is a camera to look through
        restore(scene, clip.overrides)
        driving = clip.camera
        if scene.camera == driving:
            scene.camera = clip.camera_before
        clip.camera = clip.camera_before = None
        clip.overrides = ""
        if driving is not None:
            keys = driving.animation_data.action if driving.animation_data else None
            bpy.data.batch_remove([thing for thing in (driving, driving.data, keys) if thing is not None])
        scene.frame_set(clip.frame_before)


def _driving(clip: RaucaClip, first: int) -> bpy.types.Object:
    """A camera with the start's lens that drives straight to the end and turns evenly, in no scene yet.

    Args:
        first: frame of the timeline in which it stands at the start.
    """
    start, turned, _ = clip.start.matrix_world.decompose()
    end, last_turned, _ = clip.end.matrix_world.decompose()
    lens = clip.start.data.copy()
    lens.name = "rauca clip"
    holder = bpy.data.objects.new("rauca clip", lens)
    holder.hide_select, holder.rotation_mode = True, "QUATERNION"
    for frame in range(clip.frames):
        share = frame * clip.speed / clip.frame_rate / clip.metres
        holder.location = start.lerp(end, share)
        holder.rotation_quaternion = turned.slerp(last_turned, share)
        for channel in ("location", "rotation_quaternion"):
            holder.keyframe_insert(channel, frame=first + frame)
    return holder
