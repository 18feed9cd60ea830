"""One rendered view of the vehicle, with everything that explains it.

Frame folder::

    frame.json     this module
    image.png      8-bit sRGB (`Standard` view) of the vehicle in its reference paint
    vehicle.png    8-bit coverage of the whole vehicle, anti-aliased, from a fog-free view
    paint.png      8-bit coverage of the paintable part (mask included), likewise
    semantic.png   8-bit grey, the class seen at each pixel's center (see `semantics.py`)
    instances.png  8-bit grey, which vehicle: 255 ours, 1 to 254 others, 0 none; likewise
    passes.npz     distance (H, W) float16 metres, infinity for sky; with light also A, B (H, W, 3) float16 linear
    check.png      only of some frames: rendered for real in the color ``check_srgb``, to hold A and B against
    SHA256SUMS     of all of these, for ``sha256sum --check``

Display image of any texture x (linear, per pixel, coverage-normalized): ``srgb(A * x + B)``. Outside the paint A is 0
and B is the original frame.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .color import linear_to_srgb, to_bytes
from .errors import RaucaError
from .files import atomic_folder, png_bytes, write_bytes, write_json, write_sums
from .schema import Record, Rgb8, read_json
from .semantics import CLASS_IDS, NO_INSTANCE, TARGET_INSTANCE, Box, Instance
from .vehicle import load_arrays
from .weather import Weather

PICTURE = "picture "
"""Begins what a frame was composed from where that is a photograph, or another simulator's picture."""


@dataclass(frozen=True, eq=False)
class Frame(Record):
    """What is known of a frame without opening its images.

    Attributes:
        id: the folder's name.
        location, view: indices into the data set's locations and camera ring.
        camera: world to camera.
        vehicle_to_world: (4, 4) rigid transform of the vehicle.
        weather: the weather of the frame.
        azimuth_deg, elevation_deg, distance_m: the camera seen from the vehicle's center, jitter included; azimuth 0
            looks at the vehicle's front and grows counter-clockwise from above.
        box_xyxy: (4,) pixels, the tight box of the visible vehicle; None when fewer than 16 pixels are visible.
        visible: paint pixels seen divided by paint pixels expected without occluders.
        seed: the renderer's seed for this frame.
        instances: the other vehicles in view.
        check_srgb: 8-bit sRGB paint of ``check.png``; None when the frame has none.
        exposure_stops: powers of two by which the frame is brighter than its weather's exposure makes it.
        composed: the frames that this one was composed from; empty for a rendered one. To learn from, never to judge
            by: its background is approximated.
        clip, time_s: name of the clip that it is a frame of, and the time since the clip's begin; empty for a still.
    """

    FORMAT = ("rauca-frame", 2)
    id: Annotated[str, "file_name"]
    location: int
    view: int
    camera: Camera
    vehicle_to_world: Annotated[NDArray[np.float64], (4, 4)]
    weather: Weather
    azimuth_deg: float
    elevation_deg: float
    distance_m: Annotated[float, (0, math.inf)]
    box_xyxy: Box | None
    visible: Annotated[float, (0, 1)]
    seed: int
    instances: tuple[Instance, ...] = ()
    check_srgb: Rgb8 | None = None
    exposure_stops: Annotated[float, (-16, 16)] = 0.0
    composed: tuple[str, ...] = ()
    clip: str = ""
    time_s: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """As of any record, less what only composed frames or clips have: others stay what older versions read."""
        left_out = ([] if self.composed else ["composed"]) + ([] if self.clip else ["clip", "time_s"])
        return {name: value for name, value in super().to_json().items() if name not in left_out}

    @property
    def pictured(self) -> bool:
        """Made of a picture from elsewhere: its camera stands where the photographer stood, not on the plan's ring."""
        return any(source.startswith(PICTURE) for source in self.composed)

    @property
    def camera_in_vehicle(self) -> Camera:
        """The camera in the vehicle's own frame: all that the renderer's taps depend on."""
        return self.camera.relative_to(self.vehicle_to_world)

    @property
    def place_and_weather(self) -> tuple[int, str]:
        """Location and the weather's name: frames that share both show one static scene."""
        return self.location, self.weather.name


@dataclass(eq=False)
class FramePasses:
    """The images of a frame, float32 unless said otherwise; shapes (H, W, 3) or (H, W).

    ``image_linear`` is display-referred linear light (before clipping), ``A`` and ``B`` the affine light maps,
    ``vehicle`` and ``paint`` coverage in [0, 1], ``distance`` metres along the view ray, ``semantic`` and
    ``instances`` uint8 ids. Without the ids, coverage tells what it can: paint, other parts of the vehicle,
    ``unlabeled`` elsewhere. ``check_linear`` is the frame rendered for real in ``Frame.check_srgb``.
    """

    image_linear: NDArray[np.float32]
    vehicle: NDArray[np.float32]
    paint: NDArray[np.float32]
    distance: NDArray[np.float32]
    A: NDArray[np.float32] | None = None
    B: NDArray[np.float32] | None = None
    semantic: NDArray[np.uint8] | None = None
    instances: NDArray[np.uint8] | None = None
    check_linear: NDArray[np.float32] | None = None

    def labels(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Semantic and instance ids, (H, W) uint8 each."""
        seen, paint = self.vehicle >= 0.5, self.paint >= 0.5
        parts = np.where(paint, CLASS_IDS["paint"], np.where(seen, CLASS_IDS["vehicle_part"], CLASS_IDS["unlabeled"]))
        which = np.where(seen, TARGET_INSTANCE, NO_INSTANCE)
        return (
            parts.astype(np.uint8) if self.semantic is None else self.semantic,
            which.astype(np.uint8) if self.instances is None else self.instances,
        )


def by_place_and_weather(frames: Iterable[Frame]) -> dict[tuple[int, str], list[Frame]]:
    """Frames of each location and weather, in order of both; the frames of one keep their order."""
    ordered = sorted(frames, key=lambda frame: frame.place_and_weather)
    return {key: list(some) for key, some in groupby(ordered, key=lambda frame: frame.place_and_weather)}


def save_frame(folder: Path, frame: Frame, passes: FramePasses) -> None:
    """Write a frame folder in one atomic rename."""
    largest_half = 65504.0  # float16 overflows to infinity beyond; only the sun's mirror image comes near
    stored = {"distance": passes.distance.astype(np.float16)}
    if passes.A is not None and passes.B is not None:
        stored["A"] = np.clip(passes.A, -largest_half, largest_half).astype(np.float16)
        stored["B"] = np.clip(passes.B, 0, largest_half).astype(np.float16)
    arrays = io.BytesIO()
    np.savez_compressed(arrays, **stored)
    with atomic_folder(Path(folder)) as temporary:
        for name, pixels in _images(frame, passes).items():
            write_bytes(temporary / name, png_bytes(pixels))
        write_bytes(temporary / "passes.npz", arrays.getvalue())
        write_json(temporary / "frame.json", frame.to_json())
        write_sums(temporary, [path.name for path in temporary.iterdir()])


def _images(frame: Frame, passes: FramePasses) -> dict[str, NDArray[np.uint8]]:
    """The frame's PNGs by file name."""
    semantic, instances = passes.labels()
    images = {
        "image.png": to_bytes(linear_to_srgb(passes.image_linear)),
        "vehicle.png": to_bytes(passes.vehicle),
        "paint.png": to_bytes(passes.paint),
        "semantic.png": semantic,
        "instances.png": instances,
    }
    if (frame.check_srgb is None) != (passes.check_linear is None):
        raise ValueError("a frame has both a check color and its render, or neither")
    if passes.check_linear is not None:
        images["check.png"] = to_bytes(linear_to_srgb(passes.check_linear))
    return images


def load_frame(folder: Path) -> Frame:
    """Read ``frame.json`` of a frame folder."""
    frame = Frame.from_json(read_json(Path(folder) / "frame.json"))
    if frame.id != Path(folder).name:
        raise RaucaError(f"{folder}/frame.json: id is {frame.id!r} but the folder is called {Path(folder).name!r}")
    return frame


def load_passes(folder: Path, names: tuple[str, ...] = ("A", "B", "distance")) -> dict[str, NDArray[np.float16]]:
    """Read arrays of ``passes.npz`` as stored (float16); raises :class:`RaucaError` when missing or damaged."""
    path = Path(folder) / "passes.npz"
    arrays = load_arrays(path, names)
    if strange := [name for name, array in arrays.items() if array.dtype.kind != "f"]:
        raise RaucaError(f"{path}: {strange[0]} holds values of type {arrays[strange[0]].dtype}; make it again")
    return arrays
