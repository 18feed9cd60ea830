"""Clips in the scene: camera and vehicle where a view has them, moving while the shutter is open; free ways."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ..core import clips, contract
from .blocks import set_within

BUMPER_M = 0.5  # height at which a way must be free
HALF_WIDTH_M = 0.9
HALF_LENGTH_M = 2.2


def keys(driven: clips.Clips) -> dict[float, float]:
    """Blender's frames that get keys, and seconds after the view's time.

    Blender's frame lasts as long as a view is exposed, and frame 1 is the middle. These are the frames at which Cycles
    asks for places, so nothing depends on Blender's curves between keys: those are not straight.
    """
    rolled = driven.readout_s / driven.open_s if driven.open_s else 0.0
    frames = sorted({0.5, 1 - rolled / 2, 1.0, 1 + rolled / 2, 1.5})
    return {frame: (frame - 1) * driven.open_s for frame in frames}


def move(scene: bpy.types.Scene, ways: Mapping[bpy.types.Object, Mapping[float, Matrix]], driven: clips.Clips) -> None:
    """Put objects where they are, and let them move while the clips' shutter is open.

    Args:
        ways: of each object, its place at each frame of :func:`keys`.
    """
    render, cycles = scene.render, scene.cycles
    blurred = render.use_motion_blur = driven.open_s > 0
    for thing, places in ways.items():
        thing.animation_data_clear()
        thing.rotation_mode = "QUATERNION"
        thing.matrix_world = places[1.0]
        if not blurred or all(place == places[1.0] for place in places.values()):
            continue
        before = None
        for frame, place in places.items():
            position, rotation, _ = place.decompose()
            if before is not None:
                rotation.make_compatible(before)
            thing.location, thing.rotation_quaternion, before = position, rotation, rotation
            thing.keyframe_insert("location", frame=frame)
            thing.keyframe_insert("rotation_quaternion", frame=frame)
    if blurred:
        render.motion_blur_position, render.motion_blur_shutter = "CENTER", 1.0
        # Cycles exposes each row for a share of the shutter's time; the first row at its begin, the last at its end.
        cycles.rolling_shutter_type = "TOP" if driven.readout_s else "NONE"
        cycles.rolling_shutter_duration = driven.shutter_s / driven.open_s
    scene.frame_set(1)


def sharp(scene: bpy.types.Scene) -> list[tuple[Any, str, Any]]:
    """Settings, for :func:`set_within`, under which every row shows one moment alone: the middle of its exposure."""
    render, cycles = scene.render, scene.cycles
    if not render.use_motion_blur or cycles.rolling_shutter_type == "NONE":
        return [(render, "use_motion_blur", False)]
    readout = 1 - cycles.rolling_shutter_duration
    return [(cycles, "rolling_shutter_duration", 0.0), (render, "motion_blur_shutter", readout)]


def require_free_ways(
    scene: bpy.types.Scene,
    vehicle: bpy.types.Object,
    street: clips.Street,
    driven: clips.Clips,
    manoeuvres: Sequence[str],
    where: str,
) -> None:
    """Raise :class:`RaucaError` if something stands in the way of the camera's car or of the vehicle.

    Rays are cast at the height of a bumper, from the vehicle's place, which is free, to where the drive begins and
    along it.
    """
    layer = scene.view_layers[0]
    with set_within((vehicle, "hide_viewport", True)):
        layer.update()
        for name in manoeuvres:
            first = driven.manoeuvres.index(name) * driven.frames
            for which, points in _ways(street, driven, first):
                for number, (begin, end) in enumerate(pairwise(points)):
                    struck = _between(scene, layer.depsgraph, begin, end)
                    if struck is not None:
                        time = max(number - 1, 0) / driven.frame_rate
                        raise contract.RaucaError(
                            f"{where}, {name}: the {which}'s way runs into {struck} at {time:.2f} s; drive at another "
                            "place (--seed, --locations), more slowly (--speed) or shorter (--clip-frames)"
                        )
    layer.update()


def _ways(
    street: clips.Street, driven: clips.Clips, first: int
) -> Iterator[tuple[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]]]:
    """Right and left ends (3,) of the front of both cars: at the vehicle's place, then in every frame."""
    spots = [clips.moves(driven, first + frame) for frame in range(driven.frames)]
    for index, which in enumerate(("camera", "vehicle")):
        frames = [street.at(clips.Spot()), *(street.at(both[index]) for both in spots)]
        yield which, [_front(frame, 0.0 if which == "camera" else HALF_LENGTH_M) for frame in frames]


def _front(frame: NDArray[np.float64], ahead: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    right, left = ((frame @ np.array([ahead, side, BUMPER_M, 1.0]))[:3] for side in (-HALF_WIDTH_M, HALF_WIDTH_M))
    return right, left


def _called(thing: bpy.types.Object) -> str:
    if "rauca_category" in thing:
        return f"a parked {thing['rauca_category']}"
    return "a building or what stands by the road" if thing.name.startswith("rauca town") else str(thing.name)


def _between(
    scene: bpy.types.Scene,
    graph: bpy.types.Depsgraph,
    begin: tuple[NDArray[np.float64], NDArray[np.float64]],
    end: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> str | None:
    """The name of what stands between two places of a car's front; None where nothing does."""
    for start, stop in zip(begin, end, strict=True):
        way = Vector((stop - start).tolist())
        if way.length > 1e-6:
            hit, *_, thing, _ = scene.ray_cast(graph, Vector(start.tolist()), way.normalized(), distance=way.length)
            if hit:
                return _called(thing)
    return None
