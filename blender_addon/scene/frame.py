"""One frame of a data set: its light, what the weather adds before the lens, what is known of it, the folder.

A frame's bytes depend on the plan alone, never on the frames rendered before it or by whom.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import color, contract
from .annotate import Annotation
from .light_maps import light_maps
from .metering import expose, exposure_stops
from .rain import rain_before
from .session import Session


@dataclass(eq=False)
class Sight:
    """What a camera sees without weather."""

    annotation: Annotation


@dataclass(eq=False)
class Light:
    """Linear radiance of a frame, (H, W, 3) each: ``image`` shows the reference paint, any paint x is ``A * x + B``.

    A and B are None when the plan goes without light maps.
    """

    image: NDArray[np.float32]
    A: NDArray[np.float32] | None = None
    B: NDArray[np.float32] | None = None

    def exposed(self, stops: float) -> Light:
        """The same light after a change of exposure."""
        A, B = (None if light is None else expose(light, stops) for light in (self.A, self.B))
        return Light(expose(self.image, stops), A, B)


def render_frame(session: Session, folder: Path, task: contract.PlannedFrame, sight: Sight) -> None:
    """Render a planned frame into its folder, atomically.

    The session has entered the location and set the weather. Frames of the same camera with the same light and less
    fog come first (:func:`contract.in_rendering_order`), so that the session's memory holds what they share.
    """
    light = render_light(session, task, sight)
    stops = meter(light, task, sight)
    light = add_weather_effects(session, task, sight, light.exposed(stops))
    frame, passes = describe(session, task, sight, stops), collect_passes(sight, light)
    passes.check_linear = render_check(session, task, sight, frame)
    contract.save_frame(contract.frame_folder(folder, task.id), frame, passes)


def render_light(session: Session, task: contract.PlannedFrame, sight: Sight) -> Light:
    """The frame's radiance by path tracing: both light maps, or the reference paint alone."""
    plan = session.plan
    reference = color.srgb_to_linear(np.array(plan.reference_srgb) / 255)
    if plan.light:
        paint = sight.annotation.paint / np.float32(255)
        A, B, image = light_maps(session, task.location, task.view, task.weather, paint, reference, sight.annotation)
        return Light(image, A, B)
    session.vehicle.paint.set_color(tuple(reference.tolist()))
    return Light(session.render(task.location, task.view, task.weather))


def meter(light: Light, task: contract.PlannedFrame, sight: Sight) -> float:
    """The frame's own exposure, in stops beyond the weather's."""
    ids = sight.annotation
    return exposure_stops(light.image, ids.semantic, ids.instances, task.weather.sun_altitude_angle)


def render_check(
    session: Session, task: contract.PlannedFrame, sight: Sight, frame: contract.Frame
) -> NDArray[np.float32] | None:
    """The frame in uniform paint for real, nothing composed or predicted: what the light maps are held against."""
    if frame.check_srgb is None:
        return None
    red, green, blue = color.srgb_to_linear(np.array(frame.check_srgb) / 255).tolist()
    session.vehicle.paint.set_color((red, green, blue))
    rendered = Light(session.render(task.location, task.view, task.weather)).exposed(frame.exposure_stops)
    return add_weather_effects(session, task, sight, rendered).image


def add_weather_effects(session: Session, task: contract.PlannedFrame, sight: Sight, light: Light) -> Light:
    """What is composited over the rendered light, on A and B alike so that it stays affine in the paint."""
    rain = rain_before(session, task.location, task.view, task.weather, sight.annotation.distance)
    return with_rain(light, rain)


def with_rain(light: Light, rain: contract.rain.Streaks | None) -> Light:
    """The same light behind rain."""
    if rain is None:
        return light
    return Light(
        contract.rain.over(light.image, rain),
        None if light.A is None else contract.rain.over_gain(light.A, rain),
        None if light.B is None else contract.rain.over(light.B, rain),
    )


def describe(session: Session, task: contract.PlannedFrame, sight: Sight, stops: float) -> contract.Frame:
    """What ``frame.json`` says."""
    viewpoint, plan = session.viewpoint(task.location, task.view), session.plan
    checked = color.check_color(plan.seed, plan.recolor_share, task.id) if plan.light else None
    return contract.Frame(
        id=task.id,
        location=task.location,
        view=task.view,
        camera=viewpoint.camera,
        vehicle_to_world=session.place.pose(task.location),
        weather=task.weather,
        azimuth_deg=viewpoint.azimuth_deg,
        elevation_deg=viewpoint.elevation_deg,
        distance_m=viewpoint.distance_m,
        box_xyxy=sight.annotation.box_xyxy(),
        visible=sight.annotation.visible,
        seed=session.seed(task.location, task.view, task.weather),
        instances=sight.annotation.others,
        check_srgb=checked,
        exposure_stops=stops,
    )


def collect_passes(sight: Sight, light: Light) -> contract.FramePasses:
    """The images that the frame's folder holds."""
    annotation = sight.annotation
    return contract.FramePasses(
        image_linear=light.image,
        vehicle=annotation.vehicle.astype(np.float32) / 255,
        paint=annotation.paint.astype(np.float32) / 255,
        distance=annotation.distance.astype(np.float32),
        A=light.A,
        B=light.B,
        semantic=annotation.semantic,
        instances=annotation.instances,
    )
