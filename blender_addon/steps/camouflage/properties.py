"""The camouflage on the vehicle, and the evaluation whose boxes are shown; kept in the scene."""

from __future__ import annotations

import bpy

from .shown_evaluation import loaded

_items: list[tuple[str, str, str]] = []  # Blender does not keep the strings of a list made on the fly


def _detectors(self: bpy.types.PropertyGroup, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    views = loaded(self.study)
    names = (
        dict.fromkeys(name for evaluated in views.evaluated_frames for name in evaluated.evaluation.detectors)
        if views
        else {}
    )
    _items[:] = [("ALL", "All", "Boxes of every detector"), *((n, n, "Boxes of this detector alone") for n in names)]
    return _items


class RaucaCamouflage(bpy.types.PropertyGroup):
    """What the vehicle wears; ``coat``, ``anchor`` and ``vehicle_to_anchor`` are set when it is applied."""

    file: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Camouflage", subtype="FILE_PATH", description="A camouflage's .json file, or the .png beside it"
    )
    coat: bpy.props.PointerProperty(type=bpy.types.NodeTree, options={"HIDDEN"})  # type: ignore[valid-type]
    anchor: bpy.props.PointerProperty(type=bpy.types.Object, options={"HIDDEN"})  # type: ignore[valid-type]
    vehicle_to_anchor: bpy.props.FloatVectorProperty(  # type: ignore[valid-type]
        size=16, default=[float(i % 5 == 0) for i in range(16)], options={"HIDDEN"}
    )
    study: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Evaluation", subtype="DIR_PATH", description="The folder that an evaluation wrote"
    )
    boxes: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Show Boxes", default=True, description="Draw what detectors found over the camera's view"
    )
    detector: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Detector", items=_detectors, description="Whose boxes are shown"
    )
    least_score: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Least Score",
        default=0.25,
        min=0.0,
        max=1.0,
        description="A detector's confidence, 0 to 1; boxes below are not shown",
    )
    frame: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
