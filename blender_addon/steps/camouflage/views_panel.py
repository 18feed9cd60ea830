"""The panel inside step 7 that leads through the evaluated views and tells what detectors found in them."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..panel import SidebarPanel, paragraph
from .evaluation import NORMAL, EvaluatedFrame, Views
from .shown_evaluation import ask, paint_of, same_view


class RAUCA_PT_detections(SidebarPanel, bpy.types.Panel):
    """What detectors found in the evaluated views"""

    bl_label = "What Detectors See"
    bl_parent_id = "RAUCA_PT_evaluate"
    bl_options: ClassVar[set[str]] = set()  # what was evaluated for is at hand as soon as the evaluation has ended

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.camouflage
        layout.prop(settings, "study")
        views = _views(context)
        if isinstance(views, str):
            paragraph(context, layout, views, "INFO")
            return
        evaluated_frames = same_view(context.scene, views)
        row = layout.row(align=True)
        row.operator("rauca.evaluated_view", text="", icon="TRIA_LEFT").step = "PREVIOUS"
        row.operator("rauca.evaluated_view", text="Nearest View", icon="CAMERA_DATA").step = "NEAREST"
        row.operator("rauca.evaluated_view", text="", icon="TRIA_RIGHT").step = "NEXT"
        layout.operator("rauca.evaluated_view", text="Worst View", icon="SORT_DESC").step = "WORST"
        layout.operator("rauca.leave_evaluated_view", icon="X")
        layout.prop(settings, "picture")
        if not evaluated_frames:
            paragraph(context, layout, iface("Not evaluated from here; look through the nearest view"), "INFO")
            return
        _table(context, layout, evaluated_frames)


def _views(context: bpy.types.Context) -> Views | str:
    """The evaluation to show, or why there is none."""
    settings = context.scene.rauca.camouflage
    if settings.coat is None:
        return iface("Apply a camouflage first")
    if not settings.study:
        return iface("No evaluation yet: press Evaluate, or choose the folder of one")
    return ask(settings.study) or iface("Reading the evaluation …")


def _table(context: bpy.types.Context, layout: bpy.types.UILayout, evaluated_frames: list[EvaluatedFrame]) -> None:
    """The frame's weather, and every detector with its best score."""
    settings, evaluated, paint = context.scene.rauca.camouflage, evaluated_frames[0], paint_of(context.scene)
    row = layout.row(align=True)
    row.label(text=evaluated.weather, icon="WORLD", translate=False)
    if len(evaluated_frames) > 1:
        row.operator("rauca.evaluated_view", text="", icon="LOOP_FORWARDS").step = "WEATHER"
    if paint not in evaluated.evaluation.paints:
        text = iface("The evaluation does not have {name}; it has {others}")
        others = ", ".join(name for name in evaluated.evaluation.paints if name != NORMAL)
        paragraph(context, layout, text.format(name=paint, others=others), "INFO")
        return
    file = evaluated.pictures.get(paint)
    if settings.picture and (file is None or not file.is_file()):
        paragraph(context, layout, iface("This view's picture is gone: boxes may lie beside the vehicle"), "ERROR")
    column = layout.box().column(align=True)
    for detector in evaluated.evaluation.detectors:
        best = evaluated.evaluation.of(evaluated, paint, detector)[:1]
        score = best[0].score if best else 0.0
        line = column.split(factor=0.7)
        seen = score >= settings.least_score
        line.label(text=detector, icon="HIDE_OFF" if seen else "HIDE_ON", translate=False)
        line.label(text=f"{score:.2f}" if seen else iface("not found"), translate=False)
    layout.prop(settings, "boxes")
    column = layout.column()
    column.active = settings.boxes
    column.prop(settings, "detector")
    column.prop(settings, "least_score", slider=True)
