"""OpenCV reads darknet files on its own: the same cfg, weights and image must give the same predictions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.detect import SOURCES, DarknetDetector
from rauca_core.detect.darknet_network import Head

TOLERANCE = 1e-4  # 4e-6 was measured


def cv2_predictions(cfg: Path, weights: Path, image: NDArray[np.float32], folder: Path) -> NDArray[np.float32]:
    """(N, 5 + classes) rows: center x, y, width, height over the image's size, objectness, objectness * P(class)."""
    # OpenCV zeroes scores below a threshold that the cfg may set; without this most of the comparison would be 0 = 0
    text = cfg.read_text().replace("[yolo]", "[yolo]\nthresh=1e-12").replace("[region]", "[region]\nthresh=1e-12")
    lowered = folder / "lowered.cfg"
    lowered.write_text(text)
    net = cv2.dnn.readNetFromDarknet(str(lowered), str(weights))
    net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)
    net.setInput(image)
    outputs = net.forward(net.getUnconnectedOutLayersNames())
    return np.concatenate([o.reshape(-1, o.shape[-1]) for o in outputs])


def our_predictions(detector: DarknetDetector, image: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same rows in OpenCV's order: heads, then grid cells, then anchors."""
    with torch.no_grad():
        found = detector.dense(torch.from_numpy(image))
    size = image.shape[2]
    low, high = found.boxes[0, :, :2], found.boxes[0, :, 2:]
    objectness = found.objectness[0, :, None]
    rows = torch.cat([(low + high) / 2 / size, (high - low) / size, objectness, objectness * found.classes[0]], 1)
    heads = [layer for layer in detector.network.layers if isinstance(layer, Head)]
    anchors = torch.tensor([len(head.anchors) for head in heads])
    cells = head_cells(detector, size)
    pieces = rows.split((anchors * cells).tolist())
    ordered = [
        piece.view(int(a), -1, rows.shape[1]).transpose(0, 1).reshape(-1, rows.shape[1])
        for piece, a in zip(pieces, anchors, strict=True)
    ]
    return torch.cat(ordered).numpy()


def head_cells(detector: DarknetDetector, size: int) -> torch.Tensor:
    """How many grid cells each head sees at this input size."""
    cells: list[int] = []
    hooks = [
        layer.register_forward_pre_hook(lambda _, inputs: cells.append(inputs[0].shape[2] * inputs[0].shape[3]))
        for layer in detector.network.layers
        if isinstance(layer, Head)
    ]
    detector.network(torch.zeros(1, 3, size, size))
    for hook in hooks:
        hook.remove()
    return torch.tensor(cells)


Check = Callable[[DarknetDetector, Path, Path, int], None]


@pytest.fixture
def check(tmp_path: Path, picture: Callable[[int, int], NDArray[np.float32]]) -> Check:
    """Compare predictions on a picture of a size."""

    def compare(detector: DarknetDetector, cfg: Path, weights: Path, size: int) -> None:
        image = np.ascontiguousarray(picture(size, size).transpose(2, 0, 1)[None])
        theirs, ours = cv2_predictions(cfg, weights, image, tmp_path), our_predictions(detector, image)
        assert theirs.shape == ours.shape
        spoken = theirs > 0  # the [region] layer of OpenCV suppresses overlapping boxes on its own: their scores are 0
        spoken[:, :5] = True
        assert spoken[:, 5:].mean() > 0.1, "OpenCV zeroed most scores: the comparison would prove nothing"
        assert theirs[:, 5:].max() > 0.01
        np.testing.assert_allclose(ours[spoken], theirs[spoken], atol=TOLERANCE)

    return compare


@pytest.mark.parametrize("name", ["yolov2-tiny", "yolov3-tiny", "yolov4-tiny"])
def test_published_weights_agree_with_opencv(name: str, tiny_weights: dict[str, Path], check: Check) -> None:
    source = SOURCES[name]
    detector = DarknetDetector(name, source.cfg, tiny_weights[name], source.class_names, 416)
    check(detector, source.cfg, tiny_weights[name], 416)


@pytest.mark.parametrize(("name", "published_bytes"), [("yolov3", 248007048), ("yolov4", 257717640)])
def test_full_networks_agree_with_opencv(
    name: str, published_bytes: int, tmp_path: Path, random_weights: Callable[..., Path], check: Check
) -> None:
    source = SOURCES[name]
    weights = random_weights(tmp_path / "random.weights", source.cfg)
    assert weights.stat().st_size == published_bytes  # the published file fits this cfg
    detector = DarknetDetector(name, source.cfg, weights, source.class_names, 96)
    check(detector, source.cfg, weights, 96)


@pytest.mark.parametrize("size", [64, 80])
def test_every_layer_agrees_with_opencv(size: int, cfg: Path, weights: Path, check: Check) -> None:
    check(DarknetDetector("every", cfg, weights, ("boat", "car"), size), cfg, weights, size)
