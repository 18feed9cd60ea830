"""Frames of a data set: light, what the weather adds before the lens, what is known of each, the folder.

A frame's bytes depend on the plan alone, never on the frames rendered before it or by whom. The rain's drops are the
same whatever the paint.

The camera opens up in a street's shade, as `contract/exposure.py` says. Light is linear, so a frame is exposed anew by
one multiplication after the render, of image, A and B alike.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import clips, color, contract
from ..jobs.workers import News
from .annotate import Annotation
from .light_maps import light_maps
from .session import Session

Tell = Callable[[News], None]


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

    def behind(self, rain: contract.rain.Streaks | None) -> Light:
        """The same light behind rain: composited on A and B alike, so that it stays affine in the paint."""
        if rain is None:
            return self
        A = None if self.A is None else contract.rain.over_gain(self.A, rain)
        B = None if self.B is None else contract.rain.over(self.B, rain)
        return Light(contract.rain.over(self.image, rain), A, B)


def render_chunk(
    session: Session,
    folder: Path,
    chunk: Sequence[contract.PlannedFrame],
    tell: Tell,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Render frames of one location into the data set ``folder``.

    All coverage comes first: Cycles draws other noise before the first coverage render of a process than after it, and
    a frame's bytes must not depend on what was rendered before. A frame whose paint is hidden beyond the plan's limit
    is told ``occluded``; one at which Python raises is told ``failed``, and the others go on.

    Args:
        chunk: frames of one location, as :func:`contract.chunks` gives them.
        stopped: asked before each camera's coverage and each frame; True ends the work there.

    Raises:
        RaucaError: what only the user can mend: no space, no permission.
    """
    tell(News("begin", chunk[0].id))
    session.enter(chunk[0].location)
    annotations = session.annotations(chunk[0].location, _announced(chunk, tell, stopped))
    for task in chunk:
        if stopped():
            return
        annotation = annotations[task.view]
        if annotation.visible < session.plan.min_visible:
            tell(News("occluded", task.id, visible=round(annotation.visible, 3)))
            continue
        tell(News("begin", task.id))
        started = time.perf_counter()
        try:
            session.set_weather(task.weather)
            render_frame(session, folder, task, annotation)
        except contract.RaucaError:
            raise
        except Exception as error:
            traceback.print_exc()
            tell(News("failed", task.id, reason=f"{type(error).__name__}: {' '.join(str(error).split())}"))
        else:
            tell(News("done", task.id, seconds=round(time.perf_counter() - started, 3)))


def _announced(chunk: Sequence[contract.PlannedFrame], tell: Tell, stopped: Callable[[], bool]) -> Iterator[int]:
    """The views to look at; each is told as its first frame's begin, so that a crash there has a name."""
    first: dict[int, str] = {}
    for task in chunk:
        first.setdefault(task.view, task.id)
    for view, frame_id in sorted(first.items()):
        if stopped():
            return
        tell(News("begin", frame_id))
        yield view


def render_frame(session: Session, folder: Path, task: contract.PlannedFrame, annotation: Annotation) -> None:
    """Render a planned frame into its folder, atomically.

    The session has entered the location and set the weather. Frames of the same camera with the same light and less
    fog come first (:func:`contract.in_rendering_order`), so that the session's memory holds what they share.
    """
    light = render_light(session, task, annotation)
    sun = task.weather.sun_altitude_angle
    stops = contract.exposure.metered_stops(light.image, annotation.semantic, annotation.instances, sun)
    rain = rain_before(session, task.location, task.view, task.weather, annotation.distance)
    light = light.exposed(stops).behind(rain)
    frame = describe(session, task, annotation, stops)
    passes = contract.FramePasses(
        image_linear=light.image,
        vehicle=annotation.vehicle.astype(np.float32) / 255,
        paint=annotation.paint.astype(np.float32) / 255,
        distance=annotation.distance.astype(np.float32),
        A=light.A,
        B=light.B,
        semantic=annotation.semantic,
        instances=annotation.instances,
        check_linear=render_check(session, task, frame, rain),
    )
    contract.save_frame(contract.frame_folder(folder, task.id), frame, passes)


def render_light(session: Session, task: contract.PlannedFrame, annotation: Annotation) -> Light:
    """The frame's radiance by path tracing: both light maps, or the reference paint alone."""
    plan = session.plan
    reference = color.srgb_to_linear(np.array(plan.reference_srgb) / 255)
    if plan.light:
        paint = annotation.paint / np.float32(255)
        A, B, image = light_maps(session, task.location, task.view, task.weather, paint, reference, annotation)
        return Light(image, A, B)
    session.vehicle.paint.set_color(tuple(reference.tolist()))
    return Light(session.render(task.location, task.view, task.weather))


def render_check(
    session: Session, task: contract.PlannedFrame, frame: contract.Frame, rain: contract.rain.Streaks | None
) -> NDArray[np.float32] | None:
    """The frame in uniform paint for real, nothing composed or predicted: what the light maps are held against."""
    if frame.check_srgb is None:
        return None
    red, green, blue = color.srgb_to_linear(np.array(frame.check_srgb) / 255).tolist()
    session.vehicle.paint.set_color((red, green, blue))
    rendered = Light(session.render(task.location, task.view, task.weather))
    return rendered.exposed(frame.exposure_stops).behind(rain).image


def describe(session: Session, task: contract.PlannedFrame, annotation: Annotation, stops: float) -> contract.Frame:
    """What ``frame.json`` says."""
    viewpoint, plan = session.viewpoint(task.location, task.view), session.plan
    checked = color.check_color(plan.seed, plan.recolor_share, task.id) if plan.light else None
    return contract.Frame(
        id=task.id,
        location=task.location,
        view=task.view,
        camera=viewpoint.camera,
        vehicle_to_world=session.pose(task.location, task.view),
        weather=task.weather,
        azimuth_deg=viewpoint.azimuth_deg,
        elevation_deg=viewpoint.elevation_deg,
        distance_m=viewpoint.distance_m,
        box_xyxy=annotation.box_xyxy(),
        visible=annotation.visible,
        seed=session.seed(task.location, task.view, task.weather),
        instances=annotation.others,
        check_srgb=checked,
        exposure_stops=stops,
        clip="" if plan.clips is None else clips.clip_name(plan.clips, task.location, task.view, task.weather.name),
        time_s=0.0 if plan.clips is None else plan.clips.at(task.view)[1],
    )


def rain_before(
    session: Session, location: int, view: int, weather: contract.Weather, distance: NDArray[np.floating]
) -> contract.rain.Streaks | None:
    """What falls between the camera and the scene; None in dry weather.

    Args:
        distance: (H, W) metres along the view ray as the frame stores them (half precision), infinity for sky.
    """
    if weather.precipitation == 0.0:
        return None
    seed = contract.rain.seed_of(session.plan.seed, location, view, weather)
    return contract.rain.streaks(weather, session.viewpoint(location, view).camera, distance.astype(np.float16), seed)


def expose(light: NDArray[np.float32], stops: float) -> NDArray[np.float32]:
    """Light after a change of exposure."""
    return (light * np.float32(2.0**stops)).astype(np.float32)
