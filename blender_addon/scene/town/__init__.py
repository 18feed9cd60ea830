"""A procedural town: every location stands in a district of its own, built from the data set's seed when it is entered.

`tables.py` says what each kind of district is made of, `site.py` where its street runs and where the vehicle stands;
the town shows one district at a time; the other modules build one kind of thing each.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...core import clips
from ..massing import MeshParts
from .furniture import build_furniture, build_parked
from .greenery import Nursery, build_greenery
from .materials import Materials, set_lit
from .sides import build_sides, build_skyline
from .site import Layout, Site, layout
from .streets import build_ground

LAMP_WATTS_PER_M2 = 6.5  # times the square of its height: lower lamps light the road as brightly
LAMP_COLOR = (1.0, 0.78, 0.52)
LAMP_CONE_RAD = 2.5


class Town:
    """Districts by location, built when entered and removed when left.

    Attributes:
        lamps: the present district's street lamps, which the weather switches on at night; always the same list.
        notes: what was left out or assumed, for people: nothing of a town.
    """

    def __init__(self, scene: bpy.types.Scene, seed: int, own: str = "car") -> None:
        """An empty town; none of class ``own``, that of the data set's vehicle, will be parked there."""
        self.lamps: list[bpy.types.Object] = []
        self.notes: list[str] = []
        self._scene, self._seed, self._own = scene, seed, own
        self._collection = bpy.data.collections.new("rauca town")
        scene.collection.children.link(self._collection)
        self._materials = Materials()
        self._nursery = Nursery(seed, self._materials)
        self._layouts: dict[int, Layout] = {}
        self._inside: int | None = None
        self._lit = 0.0

    def layout(self, location: int) -> Layout:
        """Where a location's street runs; nothing is built for it."""
        if location not in self._layouts:
            self._layouts[location] = layout(self._seed, location)
        return self._layouts[location]

    def pose(self, location: int) -> NDArray[np.float64]:
        """(4, 4) vehicle-to-world transform of a location: on its lane, a few degrees off the lane's line."""
        chosen = self.layout(location)
        return chosen.world @ chosen.pose

    def street(self, location: int) -> clips.Street:
        """The lane on which a location's vehicle stands."""
        return self.layout(location).street()

    def enter(self, location: int) -> None:
        """Build a location's district in place of the one before it."""
        if location == self._inside:
            return
        self._leave()
        site = Site(self.layout(location))
        build_ground(site)
        build_sides(site)
        parked = [one for one in build_parked(site) if one[0] != self._own]
        build_furniture(site)
        build_greenery(site)
        build_skyline(site)
        self._show(site, parked)
        self._inside = location

    def light_windows(self, level: float) -> None:
        """Turn up windows, signs and lamp heads, 0 to 1; the lamps' light is the weather's to turn up."""
        self._lit = level
        set_lit(level)

    def _leave(self) -> None:
        """Remove the present district, and what Cycles keeps of it.

        Cycles would keep its old order of objects and lights, and a frame's bits would depend on where one came from.
        """
        meshes = {thing.data for thing in self._collection.objects if thing.name.startswith("rauca town")}
        lights = [lamp.data for lamp in self.lamps]
        bpy.data.batch_remove([*self._collection.objects, *meshes, *lights])
        self.lamps.clear()
        if self._scene.render.use_persistent_data:
            self._scene.render.use_persistent_data = False
            self._scene.render.use_persistent_data = True

    def _show(self, site: Site, parked: list[tuple[str, MeshParts, NDArray[np.float64]]]) -> None:
        world = site.layout.world
        self._add(bpy.data.objects.new("rauca town", site.parts.to_mesh("rauca town", self._materials)), world)
        for number, (category, parts, frame) in enumerate(parked, 1):
            name = f"rauca town {category} {number}"
            vehicle = bpy.data.objects.new(name, parts.to_mesh(name, self._materials))
            vehicle["rauca_instance"], vehicle["rauca_category"] = number, category
            self._add(vehicle, world @ frame)
        for number, (model, frame) in enumerate(site.trees):
            kind, _, which = model.partition(":")
            self._add(self._nursery.plant(f"rauca tree {number}", kind, int(which)), world @ frame)
        for number, frame in enumerate(site.lamps):
            light = bpy.data.lights.new(f"rauca lamp {number}", "SPOT")
            light.energy, light.color = LAMP_WATTS_PER_M2 * site.layout.district.lamp_height_m**2, LAMP_COLOR
            light.spot_size, light.shadow_soft_size = LAMP_CONE_RAD, 0.15
            lamp = bpy.data.objects.new(f"rauca lamp {number}", light)
            lamp.hide_render = self._lit == 0.0
            self._add(lamp, world @ frame)
            self.lamps.append(lamp)

    def _add(self, thing: bpy.types.Object, frame: NDArray[np.float64]) -> None:
        thing.matrix_world = Matrix(frame.tolist())
        self._collection.objects.link(thing)
