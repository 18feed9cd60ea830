"""One rendered view of the vehicle, with everything that explains it.

Frame folder::

    frame.json     this module
    image.png      8-bit sRGB (`Standard` view) of the vehicle in its reference paint
    vehicle.png    8-bit coverage of the whole vehicle, anti-aliased, from a fog-free view
    paint.png      8-bit coverage of the paintable part (mask included), likewise
    passes.npz     distance (H, W) float16 metres, infinity for sky; with light also A, B (H, W, 3) float16 linear

Display image of any texture x (linear, per pixel, coverage-normalised): ``srgb(A * x + B)``. Outside the paint A is 0
and B is the original frame.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .colour import srgb_from_linear, to_bytes
from .errors import RaucaError
from .files import atomic_folder, png_bytes, write_bytes, write_json
from .schema import Fields, read_json
from .vehicle import load_arrays
from .weather import Weather

FORMAT = ("rauca-frame", 1)


@dataclass(frozen=True, eq=False)
class Frame:
    """What is known of a frame without opening its images.

    Attributes:
        id: the folder's name.
        location, view: indices into the data set's locations and camera ring.
        camera: world to camera.
        vehicle_to_world: (4, 4) rigid transform of the vehicle.
        weather: the weather of the frame.
        azimuth_deg, elevation_deg, distance_m: the camera seen from the vehicle's centre, jitter included; azimuth 0
            looks at the vehicle's front and grows counter-clockwise from above.
        box_xyxy: (4,) pixels, the tight box of the visible vehicle; None when fewer than 16 pixels are visible.
        visible: paint pixels seen divided by paint pixels expected without occluders.
        seed: the renderer's seed for this frame.
    """

    id: str
    location: int
    view: int
    camera: Camera
    vehicle_to_world: NDArray[np.float64]
    weather: Weather
    azimuth_deg: float
    elevation_deg: float
    distance_m: float
    box_xyxy: tuple[float, float, float, float] | None
    visible: float
    seed: int

    @property
    def camera_in_vehicle(self) -> Camera:
        """The camera in the vehicle's own frame: all that the renderer's taps depend on."""
        return self.camera.relative_to(self.vehicle_to_world)

    def to_json(self) -> dict[str, Any]:
        name, version = FORMAT
        return {
            "format": name,
            "version": version,
            "id": self.id,
            "location": self.location,
            "view": self.view,
            "camera": self.camera.to_json(),
            "vehicle_to_world": self.vehicle_to_world.tolist(),
            "weather": self.weather.to_json(),
            "azimuth_deg": self.azimuth_deg,
            "elevation_deg": self.elevation_deg,
            "distance_m": self.distance_m,
            "box_xyxy": None if self.box_xyxy is None else list(self.box_xyxy),
            "visible": self.visible,
            "seed": self.seed,
        }

    @staticmethod
    def from_json(fields: Fields) -> Frame:
        fields.format(*FORMAT)
        box = None if fields.is_null("box_xyxy") else fields.array("box_xyxy", (4,)).tolist()
        frame = Frame(
            id=fields.file_name("id"),
            location=fields.integer("location"),
            view=fields.integer("view"),
            camera=Camera.from_json(fields.nested("camera")),
            vehicle_to_world=fields.array("vehicle_to_world", (4, 4)),
            weather=Weather.from_json(fields.nested("weather")),
            azimuth_deg=fields.number("azimuth_deg"),
            elevation_deg=fields.number("elevation_deg"),
            distance_m=fields.number("distance_m", 0),
            box_xyxy=None if box is None else (box[0], box[1], box[2], box[3]),
            visible=fields.number("visible", 0),
            seed=fields.integer("seed"),
        )
        fields.done()
        return frame


@dataclass(eq=False)
class FramePasses:
    """The images of a frame, float32; shapes (H, W, 3) or (H, W).

    ``image_linear`` is display-referred linear light (before clipping), ``A`` and ``B`` the affine light maps,
    ``vehicle`` and ``paint`` coverage in [0, 1], ``distance`` metres along the view ray.
    """

    image_linear: NDArray[np.float32]
    vehicle: NDArray[np.float32]
    paint: NDArray[np.float32]
    distance: NDArray[np.float32]
    A: NDArray[np.float32] | None = None
    B: NDArray[np.float32] | None = None


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
        write_bytes(temporary / "image.png", png_bytes(to_bytes(srgb_from_linear(passes.image_linear))))
        write_bytes(temporary / "vehicle.png", png_bytes(to_bytes(passes.vehicle)))
        write_bytes(temporary / "paint.png", png_bytes(to_bytes(passes.paint)))
        write_bytes(temporary / "passes.npz", arrays.getvalue())
        write_json(temporary / "frame.json", frame.to_json())


def load_frame(folder: Path) -> Frame:
    """Read ``frame.json`` of a frame folder."""
    frame = Frame.from_json(read_json(Path(folder) / "frame.json"))
    if frame.id != Path(folder).name:
        raise RaucaError(f"{folder}/frame.json: id is {frame.id!r} but the folder is called {Path(folder).name!r}")
    return frame


def load_passes(folder: Path, names: tuple[str, ...] = ("A", "B", "distance")) -> dict[str, NDArray[np.float16]]:
    """Read arrays of ``passes.npz`` as stored (float16)."""
    return load_arrays(Path(folder) / "passes.npz", names)
