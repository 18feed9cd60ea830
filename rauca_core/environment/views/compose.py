"""A frame for a camera that nobody rendered, from the rendered views of its place.

The vehicle is rasterized: its coverage, depth and boxes are exact. What surrounds it, and what mirrors in it, is warped
from the nearest sources (`splat`, `gather`). The gain of its paint comes from them too, or from who calls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera, Frame, FramePasses, RaucaError, Vehicle, rain
from ...contract.color import to_bytes
from ...contract.exposure import metered_stops
from ...contract.semantics import CLASS_IDS, NO_INSTANCE, TARGET_INSTANCE, find_instances, mask_box
from .body import Body, see_body
from .gather import Gathered, fill_holes, gather, refine
from .lens import FAR_M, Lens
from .place import Place
from .sources import Sources
from .splat import farther, splat

NEAREST = 6  # sources that a view is composed from, by direction
SHARPNESS = 8.0  # of the weights of what surrounds the vehicle: a half at 7 degrees
MIRROR_SHARPNESS = 12.0  # on the vehicle, which mirrors
SAME_BODY = 0.006  # of the depth: the vehicle's own is known to the float16 of the sources
IN_FRONT_M = 0.15  # by which something must be nearer than the vehicle to hide it
SOLID = 0.999  # coverage from which a pixel shows nothing behind the vehicle
ROUNDS = 2  # of looking behind silhouettes

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class View:
    """Which camera, and where: what of a frame is known before it is composed."""

    id: str
    location: int
    view: int
    camera: Camera
    azimuth_deg: float
    elevation_deg: float
    distance_m: float
    seed: int

    @staticmethod
    def of(frame: Frame) -> View:
        """The camera of a frame, to be composed anew."""
        return View(
            frame.id, frame.location, frame.view, frame.camera, frame.azimuth_deg, frame.elevation_deg,
            frame.distance_m, frame.seed,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Composed:
    """A composed frame.

    Attributes:
        frame: its metadata; ``composed`` names its sources.
        passes: its images, as of a rendered frame.
        known: (H, W) True where some source saw what the pixel shows; elsewhere it was filled in.
    """

    frame: Frame
    passes: FramePasses
    known: NDArray[np.bool_]


def compose(
    place: Place,
    view: View,
    vehicle: Vehicle,
    reference_linear: Image,
    seed: int = 0,
    gain: Image | None = None,
) -> Composed:
    """Compose one view.

    Args:
        place: the sources.
        vehicle: in the pose of the sources.
        reference_linear: (3,) paint of ``image``.
        seed: of the data set: names the rain.
        gain: (H, W, 3) linear A per paint coverage, without rain and exposure; warped from the sources if None, and
            where it is NaN. What stands before the vehicle hides it, whichever it is.

    Raises:
        RaucaError: the camera's size differs from that of the sources.
    """
    lens, pose = Lens.of(view.camera), place.frames[0].vehicle_to_world
    height, width = place.around.depth.shape[1:]
    if (view.camera.width, view.camera.height) != (width, height):
        told = f"{view.camera.width}x{view.camera.height} pixels, the sources have {width}x{height}"
        raise RaucaError(f"view {view.id}: the camera has {told}; draw views of the data set's own size")
    chosen = place.nearest(lens.eye, NEAREST)
    body = see_body(vehicle, view.camera.relative_to(pose))
    around, depth = _surroundings(place.around, chosen, lens, body)
    hidden = (around.weight > 0) & (depth > 0) & (depth < body.depth - IN_FRONT_M) & (body.vehicle > 0)
    shown = np.where(hidden, np.float32(0), np.float32(1))
    share, paint = as_stored(body.vehicle * shown), as_stored(body.paint * shown)
    warped_gain, mirrored, seen = _on_vehicle(place, chosen, lens, body)
    known = np.where(share > 0.5, seen, around.weight > 0)
    if place.fog is not None:
        seen_depth = np.where(around.weight > 0, depth, 0)
        _, left = place.fog.lay_before(lens, (around.values, seen_depth), (mirrored, body.depth))
        warped_gain *= left[..., None]
    fill_holes(around.values, around.weight > 0)
    fill_holes(depth[..., None], depth > 0)
    A = (warped_gain if gain is None else np.where(np.isnan(gain), warped_gain, gain)) * paint[..., None]
    B = around.values + share[..., None] * (mirrored - around.values)
    semantic, instances, distance = _labels(around, depth, body, hidden, lens)
    return _finish(place, view, (A, B, share, paint), (semantic, instances, distance), body, chosen, known,
                   reference_linear, seed)  # fmt: skip


def _lit(A: Image, B: Image, color: Image) -> Image:
    """(H, W, 3) linear, as lit in a paint of one color."""
    image = A * color
    image += B
    return image


def as_stored(coverage: Image) -> Image:
    """Coverage as a frame's PNG keeps it: light maps are exactly those of the stored coverage."""
    return to_bytes(coverage).astype(np.float32) / np.float32(255)


def _surroundings(sources: Sources, chosen: NDArray[np.int64], lens: Lens, body: Body) -> tuple[Gathered, Image]:
    """What lies around the vehicle and before it, and its depth (H, W); nothing where the vehicle alone is seen."""
    height, width = sources.depth.shape[1:]
    depth = splat(sources, chosen, lens, height, width)
    depth[(body.vehicle > SOLID) & (depth > body.depth - IN_FRONT_M)] = 0.0
    depth = refine(sources, chosen, depth, lens)
    found = gather(sources, chosen, depth, lens, SHARPNESS)
    for _ in range(ROUNDS):
        other = farther(depth, found.weight)
        if not other.any():
            break
        behind = gather(sources, chosen, other, lens, SHARPNESS)
        new = behind.weight > 0
        depth[new] = other[new]
        for into, out in ((found.values, behind.values), (found.labels, behind.labels), (found.weight, behind.weight)):
            into[new] = out[new]
    return found, depth


def _on_vehicle(
    place: Place, chosen: NDArray[np.int64], lens: Lens, body: Body
) -> tuple[Image, Image, NDArray[np.bool_]]:
    """Gain per coverage (H, W, 3) and B (H, W, 3) of the vehicle's surface, and where a source saw it (H, W)."""
    is_paint = body.classes == CLASS_IDS["paint"]
    on_paint, off_paint = np.where(is_paint, body.depth, 0), np.where(is_paint, 0, body.depth)
    painted = gather(place.painted, chosen, on_paint, lens, MIRROR_SHARPNESS, SAME_BODY)
    rest = gather(place.rest, chosen, off_paint, lens, MIRROR_SHARPNESS, SAME_BODY)
    seen = (painted.weight > 0) | (rest.weight > 0)
    rows, columns = (np.flatnonzero(body.vehicle.any(axis)) for axis in (1, 0))
    if rows.size:  # the vehicle's own surface is all that is shown of them
        window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        for found in (painted, rest):
            fill_holes(found.values[window], found.weight[window] > 0)
    gain, mirrored = painted.values[..., :3], painted.values[..., 3:]
    share = (body.paint / np.maximum(body.vehicle, np.float32(1e-3)))[..., None]
    B = rest.values + np.minimum(share, 1) * (mirrored - rest.values)
    return gain, B, seen


def _labels(
    around: Gathered, depth: Image, body: Body, hidden: NDArray[np.bool_], lens: Lens
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], Image]:
    """Semantic class and instance at the pixels' centers, and distances along the rays in metres."""
    ours = body.center & ~hidden
    semantic = np.where(ours, body.classes, around.labels[..., 0])
    instances = np.where(ours, np.uint8(TARGET_INSTANCE), around.labels[..., 1])
    lost = (around.weight == 0) & ~ours
    semantic[lost], instances[lost] = CLASS_IDS["unlabeled"], NO_INSTANCE
    z = np.where(ours, body.depth, depth)
    distance = np.where(z > 0.5 * FAR_M, np.inf, z * lens.lengths(*z.shape))
    return semantic, instances, distance.astype(np.float32)


def _finish(
    place: Place,
    view: View,
    light: tuple[Image, Image, Image, Image],
    labels: tuple[NDArray[np.uint8], NDArray[np.uint8], Image],
    body: Body,
    chosen: NDArray[np.int64],
    known: NDArray[np.bool_],
    reference: Image,
    seed: int,
) -> Composed:
    """Exposure, rain and what ``frame.json`` says."""
    (A, B, share, paint), (semantic, instances, distance), source = light, labels, place.frames[0]
    reference = np.asarray(reference, np.float32)
    stops = metered_stops(_lit(A, B, reference), semantic, instances, source.weather.sun_altitude_angle)
    if stops:
        A, B = A * np.float32(2.0**stops), B * np.float32(2.0**stops)
    expected = body.center & (body.classes == CLASS_IDS["paint"])
    visible = float((instances[expected] == TARGET_INSTANCE).mean()) if expected.any() else 0.0
    frame = Frame(
        view.id, view.location, view.view, view.camera, source.vehicle_to_world, source.weather, view.azimuth_deg,
        view.elevation_deg, view.distance_m, mask_box(share >= 0.5), visible, view.seed,
        find_instances(instances, place.categories), None, stops, tuple(place.frames[i].id for i in chosen.tolist()),
    )  # fmt: skip
    if source.weather.precipitation > 0.0:
        drops = rain.streaks(
            source.weather,
            view.camera,
            distance.astype(np.float16),
            rain.seed_of(seed, frame.location, frame.view, frame.weather),
        )
        A, B = rain.over_gain(A, drops), rain.over(B, drops)
    A, B = A.astype(np.float32, copy=False), B.astype(np.float32, copy=False)
    passes = FramePasses(_lit(A, B, reference), share, paint, distance, A, B, semantic, instances)
    return Composed(frame, passes, known)
