"""Step 6's settings and panel."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...scene.coating import Coat
from ..on_disk import camouflage_at, picture_of
from ..panel import State, StepPanel, folder_setting, paragraph
from .painted_vehicle import vehicle_gone
from .shown_evaluation import loaded, show_picture

_items: list[tuple[str, str, str]] = []  # Blender does not keep the strings of a list made on the fly


def _detectors(self: bpy.types.PropertyGroup, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    views = loaded(self.study)
    frames = views.evaluated_frames if views else []
    names = dict.fromkeys(name for evaluated in frames for name in evaluated.evaluation.detectors)
    _items[:] = [("ALL", "All", "Boxes of every detector"), *((n, n, "Boxes of this detector alone") for n in names)]
    return _items


def _picture_wanted(self: RaucaCamouflage, context: bpy.types.Context) -> None:
    show_picture(context.scene)


class RaucaCamouflage(bpy.types.PropertyGroup):
    """What the vehicle wears; ``coat``, ``anchor`` and ``vehicle_to_anchor`` are set when it is applied."""

    file: bpy.props.StringProperty(
        name="Camouflage", subtype="FILE_PATH", description="A camouflage's .json file, or the .png beside it"
    )
    coat: bpy.props.PointerProperty(type=bpy.types.NodeTree, options={"HIDDEN"})
    anchor: bpy.props.PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    vehicle_to_anchor: bpy.props.FloatVectorProperty(
        size=16, default=[float(i % 5 == 0) for i in range(16)], options={"HIDDEN"}
    )
    study: folder_setting("Evaluation", "The folder that an evaluation wrote")
    boxes: bpy.props.BoolProperty(
        name="Show Boxes", default=True, description="Draw what detectors found over the camera's view"
    )
    detector: bpy.props.EnumProperty(name="Detector", items=_detectors, description="Whose boxes are shown")
    least_score: bpy.props.FloatProperty(
        name="Least Score",
        default=0.25,
        min=0.0,
        max=1.0,
        description="A detector's confidence, 0 to 1; boxes below are not shown",
    )
    frame: bpy.props.StringProperty(options={"HIDDEN"})
    picture: bpy.props.BoolProperty(
        name="Evaluated Picture",
        default=True,
        description="Lay the picture that the detectors saw over the evaluated view",
        update=_picture_wanted,
    )
    camera: bpy.props.PointerProperty(type=bpy.types.Object)
    camera_before: bpy.props.PointerProperty(type=bpy.types.Object)
    overrides: bpy.props.StringProperty(options={"HIDDEN"})


def state(context: bpy.types.Context) -> State:
    settings = context.scene.rauca.camouflage
    if settings.coat is not None:
        name = settings.coat.get("rauca_camouflage", "")
        if vehicle_gone(context):
            return State("missing", iface("The vehicle that wore {name} is no longer in this scene").format(name=name))
        words = {
            "ORIGINAL": iface("The original paint shows; {name} is hidden"),
            "CAMOUFLAGE": iface("The vehicle wears {name}"),
            "BAKED": iface("The vehicle wears {name}, baked"),
        }
        return State("done", words[Coat(settings.coat).shown].format(name=name))
    if not settings.file:
        return State("missing", iface("Choose a camouflage: the .json file that step 5 wrote"))
    found = camouflage_at(settings.file)
    if found is None:
        return State("missing", iface("The chosen file is no camouflage: choose its .json or .png file"))
    words = iface("Ready to apply {name}, made for {vehicle}")
    return State("ready", words.format(name=found.name, vehicle=found.vehicle_name))


class RAUCA_PT_camouflage(StepPanel, bpy.types.Panel):
    """Put a camouflage on the vehicle"""

    bl_label = "Apply Camouflage"
    number = 6
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.camouflage
        layout.prop(settings, "file", text="File")
        row = layout.row(align=True)
        row.operator("rauca.apply_camouflage", icon="BRUSH_DATA")
        row.operator("rauca.remove_camouflage", text="", icon="X")
        if settings.coat is not None:
            _draw_looks(layout, Coat(settings.coat))
            layout.operator("rauca.mark_asset", icon="ASSET_MANAGER")
            _draw_view_hint(context, layout)
        if icon := picture_of(settings.file):
            layout.template_icon(icon, scale=5)


def _draw_looks(layout: bpy.types.UILayout, coat: Coat) -> None:
    """Buttons side by side: the vehicle's own paint, the camouflage, and what was baked of it."""
    row = layout.row(align=True)
    shown = [("ORIGINAL", iface("Original")), ("CAMOUFLAGE", iface("Camouflage"))]
    if coat.image("baked") is not None:
        shown.append(("BAKED", iface("Baked")))
    for which, name in shown:
        row.operator("rauca.show_paint", text=name, depress=coat.shown == which).which = which


def _draw_view_hint(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """The solid view shows at most one image of a material, and the camouflage is mixed by nodes."""
    shading = getattr(context.space_data, "shading", None)
    if shading is None or shading.type not in {"SOLID", "WIREFRAME"}:
        return
    paragraph(context, layout, iface("This view shows no camouflage."), icon="INFO")
    row = layout.row(align=True)
    row.use_property_split = False
    row.prop_enum(shading, "type", "MATERIAL", text="Preview")
    row.prop_enum(shading, "type", "RENDERED", text="Rendered")
