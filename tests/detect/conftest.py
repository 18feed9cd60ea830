from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.detect import SOURCES, DarknetDetector
from rauca_core.detect.darknet_network import Convolution, DarknetNetwork
from tests.published import published_weights

torch.set_num_threads(1)  # small images: more threads only get in each other's way
cv2.setNumThreads(1)

TINY = ("yolov2-tiny", "yolov3-tiny", "yolov4-tiny")


@pytest.fixture(scope="session")
def tiny_weights() -> dict[str, Path]:
    """The three tiny networks' published weights, fetched through the registry once."""
    return published_weights(*TINY)


# Every layer type, activation and padding rule at once, in a net that stays small; a section a line.
SECTIONS = """
net width=64 height=64 channels=3
convolutional batch_normalize=1 filters=8 size=3 stride=2 pad=1 activation=mish
convolutional filters=8 size=3 stride=1 pad=1 activation=relu
shortcut from=-2 activation=linear
maxpool size=2 stride=2
route layers=-1 groups=2 group_id=1
convolutional batch_normalize=1 filters=16 size=3 stride=2 pad=1 activation=leaky
maxpool size=2 stride=1
maxpool size=5 stride=1
convolutional filters=21 size=1 stride=1 pad=1 activation=linear
yolo mask=1,2,3 anchors=4,6,10,9,20,22,40,31 classes=2 num=4 scale_x_y=1.05
route layers=-3
upsample stride=2
route layers=-1,3
convolutional filters=7 size=1 stride=1 pad=1 activation=linear
yolo mask=0 anchors=4,6,10,9,20,22,40,31 classes=2 num=4
"""


def cfg_of(sections: str) -> str:
    """A cfg of sections that stand in a line each."""
    parts = (line.split() for line in sections.strip().splitlines())
    return "".join(f"\n[{kind}]\n" + "".join(f"{option}\n" for option in options) for kind, *options in parts)


EVERY_LAYER = cfg_of(SECTIONS)


def write_random_weights(path: Path, cfg: Path, seed: int = 0) -> Path:
    """Seeded weights that keep activations of a deep residual network moderate, in darknet's format (version 0.2)."""
    rng = np.random.default_rng(seed)
    with path.open("wb") as stream:
        np.array([0, 2, 0], "<i4").tofile(stream)
        np.array([1234], "<i8").tofile(stream)
        for layer in DarknetNetwork(cfg).layers:
            if isinstance(layer, Convolution):
                filters = layer.bias.numel()
                fan_in = layer.weight[0].numel()
                rng.normal(0, 0.1, filters).astype("<f4").tofile(stream)
                if layer.normalized:
                    rng.uniform(0.8, 1.2, filters).astype("<f4").tofile(stream)
                    rng.normal(0, 0.1, filters).astype("<f4").tofile(stream)
                    rng.uniform(0.5, 2.0, filters).astype("<f4").tofile(stream)
                kernel = rng.normal(0, (1.0 / fan_in) ** 0.5, tuple(layer.weight.shape))
                kernel.astype("<f4").tofile(stream)
    return path


@pytest.fixture(scope="session")
def random_weights() -> Callable[..., Path]:
    """:func:`write_random_weights`."""
    return write_random_weights


@pytest.fixture(scope="session")
def backbone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seeded weights in place of YOLOv4-tiny's."""
    return write_random_weights(tmp_path_factory.mktemp("backbone") / "backbone.weights", SOURCES["yolov4-tiny"].cfg)


@pytest.fixture
def cfg(tmp_path: Path) -> Path:
    """A small cfg with every layer type; its classes are two."""
    path = tmp_path / "every.cfg"
    path.write_text(EVERY_LAYER)
    return path


@pytest.fixture
def weights(cfg: Path) -> Path:
    return write_random_weights(cfg.with_suffix(".weights"), cfg)


@pytest.fixture
def detector(cfg: Path, weights: Path) -> DarknetDetector:
    return DarknetDetector("every", cfg, weights, ("boat", "car"), 64)


@pytest.fixture(scope="session")
def picture() -> Callable[[int, int], NDArray[np.float32]]:
    """Something with edges, gradients and noise: (height, width, 3) sRGB in [0, 1]."""

    def paint(height: int, width: int) -> NDArray[np.float32]:
        rng = np.random.default_rng(3)
        canvas = cv2.resize(rng.random((8, 8, 3), np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
        cv2.rectangle(canvas, (width // 4, height // 2), (3 * width // 4, 3 * height // 4), (0.1, 0.1, 0.12), -1)
        cv2.circle(canvas, (width // 3, 3 * height // 4), height // 12, (0.02, 0.02, 0.02), -1)
        canvas += rng.normal(0, 0.03, canvas.shape).astype(np.float32)
        return canvas.clip(0, 1).astype(np.float32)

    return paint
