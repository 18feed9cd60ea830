"""Caffe's SSDs, without caffe."""

from __future__ import annotations

from pathlib import Path

from ...contract import RaucaError
from .caffe_file import read_blobs
from .caffe_layers import Builder
from .prototxt import read_prototxt
from .ssd import SsdDetector, SsdParts

# How MobileNet-SSD was trained: (BGR in 0 to 255 - 127.5) * 0.007843. A description for testing does not say it.
_SCALE = 0.007843
_NORMALISATION = (255.0 * _SCALE, -127.5 * _SCALE)


class CaffeSsdDetector(SsdDetector):
    """A caffe SSD, e.g. MobileNet-SSD for the classes of VOC, behind the detector interface.

    Scores are the network's softmax. The stretch to the network's square samples as OpenCV's resize does.
    """

    def __init__(self, name: str, prototxt: Path, weights: Path, class_names: tuple[str, ...]) -> None:
        """Read a network's description and its weights.

        Args:
            prototxt: the description for testing (deploy), in text.
            weights: the caffemodel.
            class_names: one per label from 1 on; 0 is the background.

        Raises:
            RaucaError: anything wrong with the files, weights of another network, class names of another number.
        """
        super().__init__(name, read_caffe_ssd(prototxt, weights), class_names, (prototxt, weights))


def read_caffe_ssd(prototxt: Path, weights: Path) -> SsdParts:
    """The parts of the SSD in a caffe network; see :class:`CaffeSsdDetector`."""
    built = Builder(read_prototxt(prototxt), read_blobs(weights), weights)
    output = built.output
    if output is None or output.anchors.anchors is None or output.anchors.variances is None:
        raise RaucaError(f"{prototxt}: has no DetectionOutput layer; this is no SSD for testing")
    return SsdParts(
        path=prototxt,
        layers=built.layers,
        boxes=output.boxes.layer,
        scores=output.scores.layer,
        anchors=output.anchors.anchors,
        variances=output.anchors.variances,
        columns=output.columns,
        normalization=_NORMALISATION,
        size=built.size,
        rows_first=False,
        blue_first=True,
        half_pixel_centers=True,
    )
