"""What an evaluation found, by view, weather and paint, and which of its views a camera shows; no bpy in here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core import contract, schema

STUDY, RESULTS = "study.json", "results.json"
MAX_DETECTIONS_BYTES = 2**30  # a line is some 5 kB: 200 000 images
NORMAL = "normal"  # the paint of a vehicle without camouflage


@dataclass(frozen=True)
class Detection:
    """A box in pixels of the evaluated image, left, top, right, bottom; what it is taken for; the score in [0, 1]."""

    box: tuple[float, float, float, float]
    name: str
    score: float


@dataclass(frozen=True, eq=False)
class EvaluatedFrame:
    """An evaluated frame.

    Attributes:
        frame: its id.
        weather: its name.
        camera: in the vehicle's own frame.
        images: paint -> sha256 of the image that detectors saw.
        evaluation: the one it belongs to.
    """

    frame: str
    weather: str
    camera: contract.Camera
    images: dict[str, str]
    evaluation: Evaluation


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One set of views and weathers that detectors looked at.

    Attributes:
        vehicle, category: whose frames these are, and the class that a right detection names.
        detectors: in table order.
        paints: what the vehicle wore.
        found: ``found[detector][image sha256]``, best first.
    """

    vehicle: str
    category: str
    detectors: tuple[str, ...]
    paints: tuple[str, ...]
    found: dict[str, dict[str, tuple[Detection, ...]]]

    def of(self, evaluated: EvaluatedFrame, paint: str, detector: str) -> tuple[Detection, ...]:
        """What a detector found of the evaluated class, best first."""
        detections = self.found.get(detector, {}).get(evaluated.images.get(paint, ""), ())
        return tuple(d for d in detections if d.name == self.category)


def find_evaluation(near: Path) -> Path | None:
    """The folder of the evaluation that a camouflage's file lies in, at most three folders up; or None."""
    parents = list(Path(near).resolve().parents)[:4]
    for name in (STUDY, RESULTS):
        for folder in parents:
            if (folder / name).is_file():
                return folder
    return None


def read_evaluated_frames(folder: Path) -> list[EvaluatedFrame]:
    """All evaluated frames below a study's or a demo's folder, defences left out.

    Raises:
        RaucaError: no evaluation there, or a damaged one.
    """
    folder = Path(folder)
    if (folder / STUDY).is_file():
        fields = schema.read_json(folder / STUDY)
        fields.format("rauca-study", 1)
        rows = [schema.Fields(row, f"{folder / STUDY}: entries[{i}]") for i, row in enumerate(fields.items("entries"))]
        paths = [folder / row.text("results") for row in rows if row.text("defence") == "none"]
    elif (folder / RESULTS).is_file():
        paths = [folder / RESULTS]
    else:
        raise contract.RaucaError(f"{folder}: holds no evaluation; run `rauca evaluate` and choose the folder it wrote")
    return [evaluated for path in paths for evaluated in _read_results(path)]


def _read_results(path: Path) -> list[EvaluatedFrame]:
    fields = schema.read_json(path)
    fields.format("rauca-results", 3)
    frames = [schema.Fields(row, f"{path}: frames[{i}]") for i, row in enumerate(fields.items("frames"))]
    images = fields.nested("images")
    paints = tuple(fields.raw("images"))
    rows = {paint: [schema.Fields(row, f"{path}: images") for row in images.items(paint)] for paint in paints}
    if any(len(row) != len(frames) for row in rows.values()):
        raise contract.RaucaError(f"{path}: images and frames do not fit together; evaluate again")
    fields.nested("detectors")  # an object
    detectors = tuple(fields.raw("detectors"))
    evaluation = Evaluation(
        vehicle=fields.text("vehicle") if fields.has("vehicle") else "",
        category=fields.nested("settings").text("category"),
        detectors=detectors,
        paints=paints,
        found={name: _read_detections(_folders(path, fields, name), name) for name in detectors},
    )
    evaluated_frames = []
    for i, row in enumerate(frames):
        # The image of the uncamouflaged vehicle is the data set's own and lies in the frame's folder.
        place = path.parent / rows[NORMAL][i].text("path") if NORMAL in rows else None
        if place is None or not (place.parent / "frame.json").is_file():
            raise contract.RaucaError(f"{path}: the views of {row.text('id')} are gone; evaluate again")
        frame = contract.load_frame(place.parent)
        camera = frame.camera.relative_to(frame.vehicle_to_world)
        hashes = {paint: rows[paint][i].text("sha256") for paint in paints}
        evaluated_frames.append(EvaluatedFrame(row.text("id"), row.text("weather"), camera, hashes, evaluation))
    return evaluated_frames


def _folders(path: Path, fields: schema.Fields, detector: str) -> list[Path]:
    """Where the detections of one detector are kept, of whichever paint; beside the results if they do not say."""
    named = fields.nested("detections") if fields.has("detections") else schema.Fields({}, str(path))
    of_paints = [named.nested(paint) for paint in named.names()]
    folders = {row.text(detector) for row in of_paints if row.has(detector)}
    return [path.parent / folder for folder in sorted(folders or {"detections"})]


def _read_detections(folders: Sequence[Path], detector: str) -> dict[str, tuple[Detection, ...]]:
    """What one detector found, by image; lines that a killed run left unreadable are passed over."""
    found: dict[str, tuple[Detection, ...]] = {}
    for path in (path for folder in folders for path in sorted(folder.glob("*.jsonl"))):
        if path.stem.rpartition("-")[0] != detector:  # another detector's, whose name begins with this one's
            continue
        found |= schema.whole_lines(path, MAX_DETECTIONS_BYTES, "a cache of detections", _of_an_image)
    return found


def _of_an_image(line: schema.Fields) -> tuple[str, tuple[Detection, ...]]:
    names = line.items("names")
    boxes = line.array("boxes", (len(names), 4)).tolist() if names else []
    scores = line.array("scores", (len(names),)).tolist()
    found = zip(boxes, names, scores, strict=True)
    return line.text("image"), tuple(Detection(tuple(box), str(name), score) for box, name, score in found)


SAME = 0.015  # of the picture's side: how far a corner of the vehicle may lie from where it was


class Views:
    """The cameras of evaluated frames, ready to be compared with others."""

    def __init__(self, evaluated_frames: Sequence[EvaluatedFrame]) -> None:
        self.evaluated_frames = list(evaluated_frames)
        matrices = [_projection(evaluated.camera) for evaluated in self.evaluated_frames]
        self._matrices = np.array(matrices).reshape(-1, 3, 4)

    def distances(self, corners: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each frame is from a view.

        Args:
            corners: (8, 3) points of the vehicle, in its own frame, metres.
            seen: (8, 2) where the view shows them, in [0, 1] of its width and height, from the top left.

        Returns:
            (frames,) the largest distance of a corner from where the frame shows it, in pictures; infinite where a
            corner lies behind the camera.
        """
        homogeneous = np.concatenate([corners, np.ones((len(corners), 1))], axis=1)
        projected = np.einsum("nij,kj->nki", self._matrices, homogeneous)
        depth = projected[..., 2]
        places = projected[..., :2] / np.where(depth > 1e-6, depth, np.nan)[..., None]
        away = np.abs(places - seen).max(axis=(1, 2))
        return np.where(np.isfinite(away), away, np.inf)

    def same(self, corners: NDArray[np.float64], seen: NDArray[np.float64]) -> list[EvaluatedFrame]:
        """The frames that show the vehicle like a view (see :meth:`distances`), in every weather."""
        away = self.distances(corners, seen)
        return [evaluated for evaluated, distance in zip(self.evaluated_frames, away, strict=True) if distance < SAME]


def camera_in_world(camera: contract.Camera, vehicle_to_world: NDArray[np.float64]) -> contract.Camera:
    """A camera given in the vehicle's frame, in the world."""
    turn, place = vehicle_to_world[:3, :3], vehicle_to_world[:3, 3]
    R = camera.R @ turn.T
    return contract.Camera(camera.K, R, camera.t - R @ place, camera.width, camera.height)


def _projection(camera: contract.Camera) -> NDArray[np.float64]:
    """(3, 4) from the vehicle's frame to fractions of the picture."""
    scale = np.diag([1 / camera.width, 1 / camera.height, 1.0])
    return scale @ camera.K @ np.concatenate([camera.R, camera.t[:, None]], axis=1)
