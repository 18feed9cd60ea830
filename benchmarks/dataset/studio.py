"""A data set's session, instrumented: renders with any settings, and what they cost in CPU seconds."""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from blender_addon.arguments import dataset_parser
from blender_addon.dataset_job import plan_from
from blender_addon.scene import camera
from blender_addon.scene.annotate import Annotation
from blender_addon.scene.light_maps import light_maps
from blender_addon.scene.light_memory import LightMemory
from blender_addon.scene.render import render_linear
from blender_addon.scene.session import Session
from blender_addon.vehicles import find_vehicle
from rauca_core.contract import Quality, Weather
from rauca_core.contract.color import Color, srgb_to_linear
from rauca_core.contract.seeding import named_seed

Image = NDArray[np.float32]
LOCATION = 0


@dataclass
class Cost:
    """Seconds spent: of all this process's threads, and on the wall."""

    cpu: float = 0.0
    wall: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.cpu + other.cpu, self.wall + other.wall)

    def times(self, factor: float) -> Cost:
        return Cost(self.cpu * factor, self.wall * factor)


@contextmanager
def timed() -> Iterator[Cost]:
    """Yields a cost that is filled at the end. Cycles runs inside this process, so its threads count."""
    cost, cpu, wall = Cost(), _cpu_seconds(), time.perf_counter()
    yield cost
    cost.cpu, cost.wall = _cpu_seconds() - cpu, time.perf_counter() - wall


class Studio:
    """The default data set's scene: the sedan at the town's first place, seen by the default ring.

    Attributes:
        session: of the data set's own code; its plan's quality is set per measurement.
        default: the quality that `rauca dataset make` uses.
        sights: annotations of the views that are used.
        coverage: what a camera's annotation costs, mean.
    """

    def __init__(self, size: int, views: set[int]) -> None:
        vehicle = find_vehicle("sedan", None, None)
        options = dataset_parser().parse_args(["--out", "bench", "--size", str(size), "--weathers", "single"])
        plan = plan_from(options, vehicle)
        self.default = plan.quality
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.session = Session(plan, vehicle)
        self.session.enter(LOCATION)
        self.sights: dict[int, Annotation] = {}
        with timed() as cost:
            self.sights.update(self.session.annotations(LOCATION, sorted(views)))
        self.coverage = cost.times(1 / len(views))
        self._weather: Weather | None = None

    def painted(self, view: int) -> NDArray[np.bool_]:
        """(H, W) pixels that show paint."""
        return self.sights[view].paint > 0

    def set_weather(self, weather: Weather) -> None:
        """As the data set's loop does: only when it changes."""
        if weather != self._weather:
            self.session.set_weather(weather)
            self._weather = weather

    def use(self, quality: Quality, weathers: tuple[Weather, ...] = ()) -> None:
        """Render as a plan of this quality and these weathers would; nothing rendered before is remembered."""
        self.session.plan = replace(self.session.plan, quality=quality, weathers=weathers or self.session.plan.weathers)
        self.session.memory = LightMemory(self.session.plan)

    def paint(self, color: Color) -> None:
        """Paint the vehicle all over."""
        red, green, blue = (float(c) for c in srgb_to_linear(np.array(color) / 255))
        self.session.vehicle.paint.set_color((red, green, blue))

    def settle(self, view: int, weather: Weather) -> None:
        """Let Blender take the weather in, at one sample: what comes next is timed without that."""
        usual = self.session.plan
        self.session.plan = replace(usual, quality=Quality(1, denoise=False))
        self.render(view, weather, (0, 0, 0))
        self.session.plan = usual

    def render(self, view: int, weather: Weather, color: Color, draw: int = 0) -> Image:
        """One render in one color, linear; other draws have other noise."""
        self.set_weather(weather)
        self.paint(color)
        if not draw:
            return self.session.render(LOCATION, view, weather)
        camera.place(self.session.scene, self.session.viewpoint(LOCATION, view).camera)
        seed = named_seed("reference", draw, view) % 2**31
        return render_linear(self.session.scene, self.session.plan.quality, seed)[..., :3]

    def maps(self, view: int, weather: Weather) -> tuple[Image, Image]:
        """A and B as the data set stores them, save for their rounding to half precision."""
        self.set_weather(weather)
        grey = srgb_to_linear(np.array(self.session.plan.reference_srgb, np.float32) / 255)
        A, B, _ = light_maps(self.session, LOCATION, view, weather, self.painted(view), grey, self.sights[view])
        return A, B


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
