"""What an evaluation found, by view, weather and paint, and which of its views a camera shows; no bpy in here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core import contract, schema

STUDY, RESULTS = "study.json", "results.json"
STUDY_FORMAT, RESULTS_FORMAT = ("rauca-study", 2), ("rauca-results", 5)  # as `rauca evaluate` writes them
MAX_DETECTIONS_BYTES = 2**30  # a line is some 5 kB: 200 000 images
NORMAL = "normal"  # the paint of a vehicle without camouflage


@dataclass(frozen=True)
class Detection:
    """A box in pixels of the evaluated image, left, top, right, bottom; its score in [0, 1]."""

    box: tuple[float, float, float, float]
    score: float


@dataclass(frozen=True, eq=False)
class EvaluatedFrame:
    """An evaluated frame.

    Attributes:
        frame: its id.
        weather: its name.
        camera: in the vehicle's own frame.
        images: paint -> sha256 of the image that detectors saw.
        pictures: paint -> that image's file, which may be gone.
        evaluation: the one it belongs to.
    """

    frame: str
    weather: str
    camera: contract.Camera
    images: dict[str, str]
    pictures: dict[str, Path]
    evaluation: Evaluation

    def sureness(self, paint: str) -> float:
        """The best score that each detector gives the vehicle in a paint, 0 where it is not found: their mean."""
        seen = [self.evaluation.of(self, paint, detector)[:1] for detector in self.evaluation.detectors]
        return sum(found[0].score for found in seen if found) / max(len(seen), 1)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One set of views and weathers that detectors looked at.

    Attributes:
        detectors: in table order.
        paints: what the vehicle wore.
        found: ``found[detector][image sha256]``: what was taken for the evaluated class, best first.
    """

    detectors: tuple[str, ...]
    paints: tuple[str, ...]
    found: dict[str, dict[str, tuple[Detection, ...]]]

    def of(self, evaluated: EvaluatedFrame, paint: str, detector: str) -> tuple[Detection, ...]:
        """What a detector found of the evaluated class, best first."""
        return self.found.get(detector, {}).get(evaluated.images.get(paint, ""), ())


def find_evaluation(near: Path) -> str:
    """The folder of the evaluation that a camouflage's file lies in, at most three folders up; empty: none."""
    parents = list(near.resolve().parents)[:4]
    return next((str(folder) for name in (STUDY, RESULTS) for folder in parents if (folder / name).is_file()), "")


def read_evaluated_frames(folder: Path) -> list[EvaluatedFrame]:
    """All evaluated frames below a study's or a demo's folder, defences left out.

    Raises:
        RaucaError: no evaluation there, or a damaged one.
    """
    if (folder / STUDY).is_file():
        fields = schema.read_json(folder / STUDY)
        fields.format(*STUDY_FORMAT)
        paths = [folder / row.text("results") for row in fields.objects("entries") if row.text("defence") == "none"]
    elif (folder / RESULTS).is_file():
        paths = [folder / RESULTS]
    else:
        raise contract.RaucaError(f"{folder}: holds no evaluation; choose the folder that step 7, Evaluate, wrote")
    return [evaluated for path in paths for evaluated in _read_results(path)]


def _read_results(path: Path) -> list[EvaluatedFrame]:
    fields = schema.read_json(path)
    fields.format(*RESULTS_FORMAT)
    frames, images = fields.objects("frames"), fields.nested("images")
    rows = {paint: images.objects(paint) for paint in images.names()}
    if any(len(row) != len(frames) for row in rows.values()):
        raise contract.RaucaError(f"{path}: images and frames do not fit together; evaluate again")
    detectors = fields.nested("detectors").names()
    kept, category = fields.nested("detections"), fields.nested("settings").text("category")
    of_paints = [kept.nested(paint) for paint in kept.names()]
    found = {name: _read_detections(path.parent, of_paints, name, category) for name in detectors}
    evaluation = Evaluation(tuple(detectors), tuple(rows), found)
    evaluated_frames = []
    for i, row in enumerate(frames):
        # The image of the uncamouflaged vehicle is the data set's own and lies in the frame's folder.
        place = path.parent / rows[NORMAL][i].text("path") if NORMAL in rows else None
        if place is None or not (place.parent / "frame.json").is_file():
            raise contract.RaucaError(f"{path}: the views of {row.text('id')} are gone; evaluate again")
        frame = contract.load_frame(place.parent)
        camera = frame.camera.relative_to(frame.vehicle_to_world)
        hashes = {paint: rows[paint][i].text("sha256") for paint in rows}
        files = {paint: path.parent / rows[paint][i].text("path") for paint in rows}
        evaluated_frames.append(EvaluatedFrame(row.text("id"), row.text("weather"), camera, hashes, files, evaluation))
    return evaluated_frames


def _read_detections(
    beside: Path, of_paints: list[schema.Fields], detector: str, category: str
) -> dict[str, tuple[Detection, ...]]:
    """What one detector took for a class, by image; lines that a killed run left unreadable are passed over."""

    def of_an_image(line: schema.Fields) -> tuple[str, tuple[Detection, ...]]:
        names = line.items("names")
        boxes = line.array("boxes", (len(names), 4)).tolist() if names else []
        rows = zip(boxes, names, line.array("scores", (len(names),)).tolist(), strict=True)
        return line.text("image"), tuple(Detection(tuple(box), score) for box, name, score in rows if name == category)

    found: dict[str, tuple[Detection, ...]] = {}
    folders = {row.text(detector) for row in of_paints if row.has(detector)} or {"detections"}
    for path in (path for folder in sorted(folders) for path in sorted((beside / folder).glob("*.jsonl"))):
        if path.stem.rpartition("-")[0] == detector:  # not another one's, whose name begins with this one's
            found |= schema.whole_lines(path, MAX_DETECTIONS_BYTES, "a cache of detections", of_an_image)
    return found


SAME = 0.015  # of the picture's side: how far a corner of the vehicle may lie from where it was


class Views:
    """The cameras of evaluated frames, ready to be compared with others."""

    def __init__(self, evaluated_frames: Sequence[EvaluatedFrame]) -> None:
        self.evaluated_frames = list(evaluated_frames)
        cameras = [evaluated.camera for evaluated in self.evaluated_frames]
        # (frames, 3, 4) from the vehicle's frame to fractions of the picture.
        matrices = [np.diag([1 / c.width, 1 / c.height, 1.0]) @ c.K @ np.c_[c.R, c.t] for c in cameras]
        self._matrices = np.array(matrices).reshape(-1, 3, 4)

    def same(self, corners: NDArray[np.float64], seen: NDArray[np.float64]) -> list[EvaluatedFrame]:
        """The frames that show the vehicle like a view, in every weather.

        Args:
            corners: (8, 3) points of the vehicle, in its own frame, metres.
            seen: (8, 2) where the view shows them, in [0, 1] of its width and height, from the top left.
        """
        homogeneous = np.concatenate([corners, np.ones((len(corners), 1))], axis=1)
        projected = np.einsum("nij,kj->nki", self._matrices, homogeneous)
        depth = projected[..., 2:]
        # Not a number, and so not near, where a corner lies behind the camera.
        places = projected[..., :2] / np.where(depth > 1e-6, depth, np.nan)
        near = np.abs(places - seen).max(axis=(1, 2)) < SAME
        return [evaluated for evaluated, fits in zip(self.evaluated_frames, near, strict=True) if fits]
