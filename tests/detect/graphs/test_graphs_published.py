"""The three published SSDs against OpenCV, which reads the same files on its own, on frames of the project."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.classes import GAP, class_list
from rauca_core.detect.graphs.ssd import SsdDetector
from rauca_core.detect.weights import weights_folder
from tests.detect.gradients import checked_gradient

SHEET = Path(__file__).parents[3] / "docs" / "pictures" / "dataset.jpg"  # frames of 166 pixels in rows and columns
TILES = [(22, 98), (194, 98), (194, 270), (194, 614), (366, 98), (1054, 614)]
TILE = 166
TOLERANCE = 1e-3  # 6e-5 was measured on encodings, 3e-6 on scores


@dataclass(frozen=True)
class Published:
    """A network: ours, OpenCV's, and what OpenCV calls its parts (encodings, scores, anchors)."""

    detector: SsdDetector
    net: cv2.dnn.Net
    parts: tuple[str, str, str]
    scale: float
    shift: float
    threshold: float
    overlap: float
    rows_first: bool
    blue_first: bool

    def run(self, images: Tensor) -> list[NDArray[np.float32]]:
        """OpenCV's encodings, scores, anchors and detections of one image of the network's size."""
        blob = images.numpy()[:, ::-1] if self.blue_first else images.numpy()
        self.net.setInput(np.ascontiguousarray(blob * self.scale + self.shift))
        return list(self.net.forward([*self.parts, "detection_out"]))


def in_cache(name: str) -> Path:
    path = weights_folder() / name
    if not path.is_file():
        pytest.skip(f"{path.name} is not in the cache; run `rauca weights fetch {path.stem}`")
    return path


def tensorflow(name: str, scale: float, shift: float) -> Published:
    graph, description = in_cache(f"{name}.pb"), in_cache(f"{name}.pbtxt")
    detector = load_detector(graph, names=class_list("coco-91"))
    parts = ("BoxEncodingPredictor/concat", "ClassPredictor/concat/sigmoid", "PriorBox/concat")
    net = cv2.dnn.readNetFromTensorflow(str(graph), str(description))
    return Published(detector, net, parts, scale, shift, 0.3, 0.6, True, False)


def caffe(name: str) -> Published:
    files = in_cache(f"{name}.prototxt"), in_cache(f"{name}.caffemodel")
    net = cv2.dnn.readNetFromCaffe(*map(str, files))
    parts = ("mbox_loc", "mbox_conf_flatten", "mbox_priorbox")
    detector = load_detector(files[1])
    return Published(detector, net, parts, 255 * 0.007843, -127.5 * 0.007843, 0.25, 0.45, False, True)


@pytest.fixture(scope="module", params=["ssd-mobilenet-v2", "ssd-mobilenet-v3", "mobilenet-ssd"])
def published(request: pytest.FixtureRequest) -> Published:
    match request.param:
        case "ssd-mobilenet-v2":  # its graph brings the image to [-1, 1] itself
            found = tensorflow(request.param, 255.0, 0.0)
        case "ssd-mobilenet-v3":
            found = tensorflow(request.param, 2.0, -1.0)
        case _:
            found = caffe(request.param)
    found.net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)
    return found


@pytest.fixture(scope="module")
def frames() -> Tensor:
    """(6, 3, 166, 166) sRGB: cars in several weathers."""
    sheet = cv2.imread(str(SHEET))[..., ::-1]
    tiles = np.stack([sheet[top : top + TILE, left : left + TILE] for top, left in TILES])
    return torch.from_numpy(tiles).permute(0, 3, 1, 2).float() / 255


def squared(images: Tensor, size: int) -> Tensor:
    return torch.nn.functional.interpolate(images, size=(size, size), mode="bilinear")


def test_heads_anchors_and_detections_agree_with_opencv(published: Published, frames: Tensor) -> None:
    detector, compared = published.detector, 0
    for image in squared(frames, detector.size).split(1):
        code, scores, priors, theirs = published.run(image)
        found = detector.dense(image)
        with torch.no_grad():
            encodings = detector.network.layers(image)[0].reshape(1, -1, 4)
        columns = scores.reshape(found.classes.shape[1], -1)[:, 1:]
        order = [1, 0, 3, 2] if published.rows_first else [0, 1, 2, 3]  # OpenCV turns TensorFlow's encodings to x, y
        np.testing.assert_allclose(encodings[0][:, order], code.reshape(-1, 4), atol=TOLERANCE)
        np.testing.assert_allclose(found.classes[0], columns, atol=TOLERANCE)
        center, half = detector.network.boxes.center, detector.network.boxes.size / 2
        anchors = torch.cat([center - half, center + half], 1)
        np.testing.assert_allclose(anchors, priors.reshape(2, -1, 4)[0], atol=TOLERANCE)
        compared += compare_detections(published, image, theirs[0, 0])
    assert compared >= 6


def compare_detections(published: Published, image: Tensor, theirs: NDArray[np.float32]) -> int:
    """Class by class, best first; boxes relative to the image. Returns how many were compared."""
    detector = published.detector
    ours = detector.detect(image, published.threshold, published.overlap)[0]
    theirs = theirs[theirs[:, 2] > published.threshold]
    theirs = theirs[np.lexsort((-theirs[:, 2], theirs[:, 1]))]
    rows = torch.cat([ours.labels[:, None] + 1, ours.scores[:, None], ours.boxes / detector.size], 1).numpy()
    rows = rows[np.lexsort((-rows[:, 1], rows[:, 0]))]
    theirs[:, 3:] = theirs[:, 3:].clip(0, 1)
    np.testing.assert_allclose(rows, theirs[:, 1:], atol=TOLERANCE)
    return len(rows)


def test_a_car_is_a_car_in_frames_of_any_size(published: Published, frames: Tensor) -> None:
    detector = published.detector
    car = detector.class_names.index("car")
    for images in (frames, torch.nn.functional.interpolate(frames, size=(400, 480), mode="bilinear")):
        height, width = images.shape[2:]
        scores = []
        for one in detector.detect(images, 0.1):
            cars = one.labels == car
            scores.append(float(one.scores[cars].max()) if cars.any() else 0.0)
            if cars.any():
                middle = (one.boxes[cars][0, :2] + one.boxes[cars][0, 2:]) / 2
                assert (middle / torch.tensor([width, height]) - 0.5).abs().max() < 0.25
        assert np.median(scores) > 0.5, scores


def test_gradient_matches_finite_differences(published: Published, frames: Tensor) -> None:
    detector = published.detector
    try:  # away from 0 and 1, which images must not leave; the smaller the step, the fewer kinks lie within
        images = 0.1 + 0.8 * frames[1:2]
        gradient = checked_gradient(detector, images, boxes=1e-4, step=1e-9, rtol=1e-3, atol=1e-5)
        assert (gradient.abs().sum(1) > 0).double().mean() > 0.95
    finally:
        detector.network.float()


def test_a_batch_is_its_images(published: Published, frames: Tensor) -> None:
    detector = published.detector
    with torch.no_grad():
        together = detector.dense(frames[:2])
        alone = [detector.dense(frames[k : k + 1]) for k in range(2)]
    torch.testing.assert_close(together.classes, torch.cat([one.classes for one in alone]), atol=1e-5, rtol=0)
    torch.testing.assert_close(together.boxes, torch.cat([one.boxes for one in alone]), atol=1e-2, rtol=1e-4)


def test_eighty_names_pick_the_same_columns_as_ninety(frames: Tensor) -> None:
    graph = in_cache("ssd-mobilenet-v3.pb")
    ninety = load_detector(graph, names=class_list("coco-91"))
    eighty = load_detector(graph, names=class_list("coco-80"))
    with torch.no_grad():
        every, picked = (detector.dense(frames[:1]).classes[0] for detector in (ninety, eighty))
    kept = [column for column, name in enumerate(ninety.class_names) if name != GAP]
    torch.testing.assert_close(picked, every[:, kept])
    assert [ninety.class_names[k] for k in kept] == list(eighty.class_names)
    assert len({detector.fingerprint for detector in (ninety, eighty)}) == 2
    with pytest.raises(RaucaError, match=r"predicts 90 classes, or the 80 of COCO; 20 class names were given"):
        load_detector(graph, names=class_list("voc-20"))


def test_anchors_are_those_of_the_documented_generator() -> None:
    """ssd_anchor_generator: scales from 0.2 to 0.95 over six maps, ratios 1 to 3, fewer on the first."""
    detector = load_detector(in_cache("ssd-mobilenet-v2.pb"), names=class_list("coco-91"))
    scales = [*np.linspace(0.2, 0.95, 6), 1.0]
    expected = []
    for number, cells in enumerate((19, 10, 5, 3, 2, 1)):
        shapes = [(scales[number], ratio) for ratio in (1.0, 2.0, 0.5, 3.0, 0.3333)]
        shapes.append(((scales[number] * scales[number + 1]) ** 0.5, 1.0))
        if number == 0:
            shapes = [(0.1, 1.0), (0.2, 2.0), (0.2, 0.5)]
        for y in range(cells):
            for x in range(cells):
                expected += [((x + 0.5) / cells, (y + 0.5) / cells, s * r**0.5, s / r**0.5) for s, r in shapes]
    ours = torch.cat([detector.network.boxes.center, detector.network.boxes.size], 1)
    np.testing.assert_allclose(ours, np.array(expected), atol=1e-6)
