"""Settings of the weather step, kept in the scene; the sliders act at once while a weather is shown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import bpy

from ...core import contract
from ...scene import shown_weather, street
from ..cameras.properties import anchor
from ..panel import angle
from . import gallery
from .gallery import Item, gallery_items

CHANGED = "my-weather"  # the name of a weather that the sliders made
ANGLES = {"sun_altitude": "sun_altitude_angle", "sun_azimuth": "sun_azimuth_angle"}
# Sliders in CARLA's terms; the contract calls them so.
NUMBERS = {
    "fog": "fog_density",
    "fog_falloff": "fog_falloff",
    "fog_distance": "fog_distance",
    "clouds": "cloudiness",
    "rain": "precipitation",
    "wetness": "wetness",
    "puddles": "precipitation_deposits",
    "wind": "wind_intensity",
}


def _moved(self: RaucaWeather, context: bpy.types.Context) -> None:
    """A slider was moved."""
    if not self.setting:
        self.refresh()


def _listed(self: RaucaWeather, context: bpy.types.Context | None) -> list[Item]:
    return gallery_items(self.listed())


def _picked(self: RaucaWeather) -> int:
    names = [weather.name for weather in self.listed()]
    return names.index(self.picked) if self.picked in names else 0


def _pick(self: RaucaWeather, number: int) -> None:
    self.pick(self.listed()[number])


def _other_list(self: RaucaWeather, context: bpy.types.Context) -> None:
    """Another list was chosen: begin with its first weather."""
    if weathers := self.listed():
        self.pick(weathers[0])


_angle = partial(angle, update=_moved)


def _slider(name: str, tip: str, default: float = 0.0, top: float = 100.0) -> bpy.props._PropertyDeferred:
    return bpy.props.FloatProperty(
        name=name, description=tip, default=default, min=0.0, max=top, precision=1, step=100, update=_moved
    )


class RaucaShownWeather(bpy.types.PropertyGroup):
    """What the add-on has put into the scene, and what it replaced; see `scene/shown_weather.py`."""

    on: bpy.props.BoolProperty()
    world: bpy.props.PointerProperty(type=bpy.types.World)
    world_before: bpy.props.PointerProperty(type=bpy.types.World)
    fog: bpy.props.PointerProperty(type=bpy.types.Object)
    sun: bpy.props.PointerProperty(type=bpy.types.Object)
    ground: bpy.props.PointerProperty(type=bpy.types.Object)
    overrides: bpy.props.StringProperty()


class RaucaWeather(bpy.types.PropertyGroup):
    """One weather in sliders, the list it was picked from, and which weathers the dataset gets."""

    used: bpy.props.EnumProperty(
        name="Dataset Gets",
        items=[
            ("LIST", "Whole List", "Every view is rendered in each weather of the list"),
            ("ONE", "This One", "Every view is rendered in the weather of the sliders"),
        ],
        description="The weathers in which every view is rendered",
    )
    preset: bpy.props.EnumProperty(
        name="List",
        items=[*gallery.SHIPPED, (gallery.OWN, "From a File", "A list of weathers of your own")],
        description="The list of weathers to choose from",
        update=_other_list,
    )
    file: bpy.props.StringProperty(
        name="File", subtype="FILE_PATH", description="A .json file with a list of weathers", update=_other_list
    )
    picture: bpy.props.EnumProperty(
        name="Weather", items=_listed, get=_picked, set=_pick, description="Click to choose another weather"
    )
    picked: bpy.props.StringProperty(default="clear-day", options={"HIDDEN"})
    sun_altitude: _angle(
        "Sun Height", "Above the horizon; below it lamps come on, and under -18 degrees it is night", 45, -90, 90
    )
    sun_azimuth: _angle("Sun Direction", "Counter-clockwise seen from above; 0 is the street map's east", 60, -360, 360)
    fog: _slider("Fog", "You see about 1000 m at 25, 260 m at 50 and 65 m at 100")
    fog_falloff: _slider("Fog Thins Out", "How fast fog thins out upwards; 0: not at all", top=1000.0)
    fog_distance: bpy.props.FloatProperty(
        name="Fog Begins", subtype="DISTANCE", min=0.0, soft_max=100.0, max=1e6, update=_moved,
        description="Fog keeps clear of this distance around the camera",
    )  # fmt: skip
    clouds: _slider("Clouds", "0 is a clear sky, 100 an overcast one without any sun")
    rain: _slider("Rain", "30 is moderate, 60 heavy, 100 violent rain; it also wets what it falls on")
    wetness: _slider("Wetness", "How wet surfaces are")
    puddles: _slider("Puddles", "How much of the flat ground lies under water")
    wind: _slider("Wind", "Slants the rain")
    place: bpy.props.IntProperty(
        name="Street", default=1, min=1, max=100, description="Which of the dataset's streets, each in another district"
    )
    street: bpy.props.PointerProperty(type=bpy.types.Collection)
    street_turn_deg: bpy.props.FloatProperty()
    ground: bpy.props.BoolProperty(
        name="Ground",
        default=True,
        description="Put a plain grey ground under the vehicle while no street is there",
        update=_moved,
    )
    shown: bpy.props.PointerProperty(type=RaucaShownWeather)
    setting: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})

    @property
    def used_by_hand(self) -> bool:
        """Whether anything of this step was chosen in this file."""
        return self.shown.on or any(self.is_property_set(name) for name in ("used", "preset", "file", "picked"))

    def listed(self) -> Sequence[contract.Weather]:
        """The weathers of the chosen list; empty when the user's file cannot be read."""
        if self.preset != gallery.OWN:
            return gallery.shipped(self.preset)
        try:
            return gallery.own(bpy.path.abspath(self.file))
        except contract.RaucaError:
            return ()

    def current(self) -> contract.Weather:
        """The weather of the sliders, under the picked one's name if it is that one."""
        # Sliders are single precision and angles radians: three decimals are what the user sees and means.
        numbers = {theirs: round(math.degrees(getattr(self, mine)), 3) for mine, theirs in ANGLES.items()}
        numbers |= {theirs: round(getattr(self, mine), 3) for mine, theirs in NUMBERS.items()}
        weather = contract.Weather(self.picked, **numbers)
        return weather if weather in self.listed() else replace(weather, name=CHANGED)

    def pick(self, weather: contract.Weather) -> None:
        """Move all sliders to a weather."""
        self.setting = True
        try:
            for mine, theirs in ANGLES.items():
                setattr(self, mine, math.radians(getattr(weather, theirs)))
            for mine, theirs in NUMBERS.items():
                setattr(self, mine, getattr(weather, theirs))
            self.picked = weather.name
        finally:
            self.setting = False
        self.refresh()

    def refresh(self) -> None:
        """Bring a shown weather up to date; nothing is added to a scene that shows none."""
        if self.shown.on:
            self.show()

    def show(self) -> None:
        """Put the sliders' weather into this scene."""
        scene, ground = self.id_data, anchor(bpy.context).vehicle_to_world[:3, 3]
        lamps = street.lamps(self.street)
        shown_weather.show(scene, self.shown, self.current(), lamps, ground, self.street_turn_deg)
        self.shown.ground.hide_render = self.shown.ground.hide_viewport = self.street is not None or not self.ground

    def chosen(self) -> tuple[Sequence[contract.Weather], Sequence[str]]:
        """The weathers that the dataset gets, and what the user should know of them.

        Raises:
            RaucaError: no file is chosen, or it cannot be read.
        """
        if self.used == "ONE":
            return [self.current()], ()
        if self.preset != gallery.OWN:
            return gallery.shipped(self.preset), ()
        path = bpy.path.abspath(self.file) if self.file else ""
        return gallery.own(path), contract.preset_notes(path)
