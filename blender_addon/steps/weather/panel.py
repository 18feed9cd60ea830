"""The weather step's panel, and what its buttons do."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_tip as tip

from ...scene import shown_weather, street
from ...scene.town.materials import NIGHT_GROUP
from ...scene.wetness import GROUP as WETTABLE
from ..cameras.properties import anchor
from ..operator import LINKED, NOT_OBJECT_MODE, Obstacle, RaucaOperator
from ..panel import Kind, State, StepPanel, paragraph
from . import gallery
from .gallery import display_name
from .properties import RaucaWeather


def state(context: bpy.types.Context) -> State:
    """Which weathers the dataset gets; done once something of them was set."""
    settings = context.scene.rauca.weather
    kind: Kind = "done" if settings.used_by_hand else "ready"
    if settings.used == "ONE":
        name = display_name(settings.current().name)
        return State(kind, iface("One weather for the dataset: {name}").format(name=name))
    if settings.preset != gallery.OWN:
        return State(kind, iface("{count} weathers for the dataset").format(count=len(settings.listed())))
    if not settings.file:
        return State("missing", iface("Choose your file of weathers"))
    if not settings.listed():
        return State("missing", iface("The file of weathers cannot be read; choose another"))
    return State(kind, iface("{count} weathers for the dataset").format(count=len(settings.listed())))


class RAUCA_PT_weather(StepPanel, bpy.types.Panel):
    """Choose the weathers and look at them in the viewport"""

    bl_label = "Weather"
    number = 2
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.weather
        layout.prop(settings, "preset")
        if settings.preset == gallery.OWN:
            layout.prop(settings, "file")
        layout.row().prop(settings, "used", expand=True)
        _draw_gallery(settings, layout)
        _draw_viewport(settings, layout)
        _draw_sliders(settings, layout)
        if settings.shown.on:  # last: what it says changes with the view and the weather
            _draw_caveats(context, settings, layout)


def _draw_gallery(settings: RaucaWeather, layout: bpy.types.UILayout) -> None:
    """The picked weather's picture; a click opens the others."""
    if not settings.listed():
        return
    column = layout.column(align=True)
    column.template_icon_view(settings, "picture", show_labels=True, scale=6.0, scale_popup=5.0)
    row = column.row(align=True)
    row.operator("rauca.next_weather", text="", icon="TRIA_LEFT").step = -1
    name = row.row(align=True)
    name.alignment = "EXPAND"
    name.operator("rauca.next_weather", text=display_name(settings.current().name), translate=False).step = 1
    row.operator("rauca.next_weather", text="", icon="TRIA_RIGHT").step = 1


def _draw_viewport(settings: RaucaWeather, layout: bpy.types.UILayout) -> None:
    row = layout.row(align=True)
    if settings.shown.on:
        row.operator("rauca.remove_weather", icon="X")
    else:
        row.operator("rauca.show_weather", icon="WORLD")
    row = layout.row(align=True)
    if settings.street is not None:
        row.operator("rauca.remove_street", icon="X")
    else:
        row.use_property_split = False
        row.operator("rauca.set_up_street", icon="HOME")
        number = row.row(align=True)
        number.scale_x = 0.5
        number.prop(settings, "place", text="")
    ground = layout.row()
    ground.enabled = settings.shown.on and settings.street is None
    ground.prop(settings, "ground")


def _draw_caveats(context: bpy.types.Context, settings: RaucaWeather, layout: bpy.types.UILayout) -> None:
    """What the present view leaves out, with the button that mends it."""
    shading, weather = getattr(context.space_data, "shading", None), settings.current()
    kind = shading.type if shading is not None else "RENDERED"
    cycles = context.scene.render.engine == "CYCLES"
    box = layout.box().column()
    box.use_property_split = False
    if kind in {"SOLID", "WIREFRAME"}:
        paragraph(context, box, iface("This view shows no weather."), icon="INFO")
        row = box.row(align=True)
        if not cycles:
            row.prop_enum(context.scene.render, "engine", "CYCLES", text="Use Cycles")
        row.prop_enum(shading, "type", "RENDERED", text="Rendered View")
    elif kind == "MATERIAL" or not cycles:
        text = iface(
            "EEVEE: sky and clouds as in the dataset; sun, shadows and fog come close, no more. Cycles is exact."
        )
        paragraph(context, box, text, icon="INFO")
        if shading is not None and kind == "MATERIAL" and not shading.use_scene_world:
            box.prop(shading, "use_scene_world", text="Show This Sky", toggle=True)
            box.prop(shading, "use_scene_lights", text="Show This Sun", toggle=True)
        elif not cycles:
            box.prop_enum(context.scene.render, "engine", "CYCLES", text="Use Cycles")
    else:
        paragraph(context, box, iface("Cycles: sky, sun, clouds and fog as in the dataset."), icon="CHECKMARK")
    if weather.precipitation > 0.0:
        text = iface("Rain falls before everything here; in the frames what is near hides it.")
        paragraph(context, box, text, icon="INFO")
    if weather.film > 0.0:
        if WETTABLE in bpy.data.node_groups:
            text = iface("Rauca's vehicles and streets get wet; materials of your own stay dry.")
        else:
            text = iface("Nothing here can get wet: Rauca's vehicles and streets do, materials of your own stay dry.")
        paragraph(context, box, text, icon="INFO")
    if weather.lamps > 0.0 and NIGHT_GROUP not in bpy.data.node_groups:
        paragraph(context, box, iface("Night without lamps: set up a street to see it lit."), icon="INFO")


def _draw_sliders(settings: RaucaWeather, layout: bpy.types.UILayout) -> None:
    for names in (("sun_altitude", "sun_azimuth"), ("clouds", "fog"), ("rain", "wetness", "puddles")):
        column = layout.column(align=True)
        for name in names:
            column.prop(settings, name, slider=name not in {"sun_azimuth"})
    header, body = layout.panel("RAUCA_weather_more", default_closed=True)
    header.label(text="More")
    if body is not None:
        column = body.column(align=True)
        for name in ("fog_falloff", "fog_distance", "wind"):
            column.prop(settings, name)


class RAUCA_OT_show_weather(RaucaOperator, bpy.types.Operator):
    """Put sky, sun, clouds and fog into this scene; your own world is kept and comes back with Remove Weather"""

    bl_label = "Show in This Scene"
    obstacles = (LINKED,)

    def work(self, context: bpy.types.Context) -> None:
        context.scene.rauca.weather.show()


class RAUCA_OT_remove_weather(RaucaOperator, bpy.types.Operator):
    """Bring back your own world and settings; exactly what was added goes"""

    bl_label = "Remove Weather"
    obstacles = (Obstacle("This scene shows no weather", lambda context: not context.scene.rauca.weather.shown.on),)

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        shown_weather.remove(context.scene, settings.shown, street.lamps(settings.street))


class RAUCA_OT_next_weather(RaucaOperator, bpy.types.Operator):
    """Go on to the next weather of the list; after the last comes the first"""

    bl_label = "Next Weather"
    obstacles = (
        Obstacle(
            "The list of weathers is empty: choose another list or file",
            lambda context: not context.scene.rauca.weather.listed(),
        ),
    )

    step: bpy.props.IntProperty(name="Step", default=1, options={"SKIP_SAVE"})

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return tip("Go back to the weather before; before the first comes the last") if properties.step < 0 else ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        weathers = settings.listed()
        names = [weather.name for weather in weathers]
        # From a weather of the sliders' own, forward leads to the picked one's neighbor all the same.
        number = names.index(settings.picked) if settings.picked in names else -1
        settings.pick(weathers[(number + self.step) % len(weathers)])


class RAUCA_OT_set_up_street(RaucaOperator, bpy.types.Operator):
    """Build a street of the dataset's town around the vehicle, which stays where it is"""

    bl_label = "Set Up a Street"
    obstacles = (
        NOT_OBJECT_MODE,
        Obstacle(
            "This scene has a street: remove it first", lambda context: context.scene.rauca.weather.street is not None
        ),
    )

    def work(self, context: bpy.types.Context) -> None:
        settings, seed = context.scene.rauca.weather, context.scene.rauca.dataset.seed
        built = street.build(context.scene, seed, settings.place - 1, anchor(context).vehicle_to_world)
        settings.street, settings.street_turn_deg = built
        settings.refresh()


class RAUCA_OT_remove_street(RaucaOperator, bpy.types.Operator):
    """Remove the street and everything that came with it; objects of your own among the houses stay"""

    bl_label = "Remove Street"
    obstacles = (
        NOT_OBJECT_MODE,
        Obstacle("This scene has no street", lambda context: context.scene.rauca.weather.street is None),
    )

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        street.remove(context.scene, settings.street)
        settings.street, settings.street_turn_deg = None, 0.0
        settings.refresh()
