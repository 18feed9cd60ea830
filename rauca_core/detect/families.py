"""The families of detectors: how the files of each are known, and what loads them.

Another family is one file, with an adapter of :class:`rauca_core.detect.Detector` and a function ``load``, and one row
of :data:`FAMILIES`. Adapters are imported when one of their detectors is wanted: frameworks take seconds, and may not
be installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from ..contract import RaucaError
from .interface import Detector

EXTRA = "pip install 'rauca[detectors]'"
# MMDetection 3 as it installs: from source where no compiled operators fit torch, and without what would replace ours.
MMDET_INSTALL = (
    "pip install 'setuptools<81' wheel ninja psutil && "
    "pip install addict yapf termcolor terminaltables pyyaml matplotlib pycocotools scipy shapely tqdm six && "
    "MMCV_WITH_OPS=1 FORCE_CUDA=0 pip install --no-deps --no-build-isolation --no-binary mmcv mmcv==2.1.0 && "
    "pip install --no-deps mmengine==0.10.7 mmdet==3.3.0"
)
TORCHVISION = (
    "fasterrcnn_resnet50_fpn", "fasterrcnn_resnet50_fpn_v2", "fasterrcnn_mobilenet_v3_large_fpn",
    "fasterrcnn_mobilenet_v3_large_320_fpn", "retinanet_resnet50_fpn", "retinanet_resnet50_fpn_v2",
    "fcos_resnet50_fpn", "ssd300_vgg16", "ssdlite320_mobilenet_v3_large",
)  # fmt: skip
"""Its detection models, by their names there."""


@dataclass(frozen=True)
class Resolved:
    """Everything a detector is built from.

    Attributes:
        files: the weights first, then what lies beside them.
        class_names: None when the weights say so themselves, as many ONNX and transformers files do.
        network: see :class:`rauca_core.detect.Source`.
    """

    name: str
    family: str
    files: tuple[Path, ...]
    class_names: tuple[str, ...] | None
    network: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The class names, of families whose weights never hold them."""
        if self.class_names is None:
            raise RaucaError(
                f"{self.name}: no class names; write them, one per line, into a .names file beside the weights"
            )
        return self.class_names


@dataclass(frozen=True)
class Family:
    """How one family's files are known and loaded.

    Attributes:
        adapter: module of this package with ``load(found: Resolved, size: int | None) -> Detector``.
        suffix: of weights that say what they are, so that their path alone may be given.
        folder: its weights are a folder.
        beside: suffix of a file that must lie beside the weights.
        classes: the list that weights without a ``.names`` file speak of.
        packages: it imports beyond rauca's own requirements, each under the name it is imported by.
        install: the command that gets them.
        resizable: its detectors may be given another input size.
        named: its files name the classes, and no others can be given.
        networks: kinds of network that its files may be told to be, as ``NETWORK=PATH``.
    """

    adapter: str
    suffix: str = ""
    folder: bool = False
    beside: str = ""
    classes: str = ""
    packages: tuple[str, ...] = ()
    install: str = EXTRA
    resizable: bool = True
    named: bool = False
    networks: tuple[str, ...] = ()

    def load(self, found: Resolved, size: int | None) -> Detector:
        """The detector, on the CPU; errors as of :func:`rauca_core.detect.load_detector`."""
        if size is not None and not self.resizable:
            raise RaucaError(f"{found.name}: the input size of a {found.family} detector is its own; leave size out")
        detector: Detector = import_module(f".{self.adapter}", __package__).load(found, size)
        return detector

    @property
    def missing_package(self) -> str:
        """The command that gets what is not installed; empty when nothing is missing."""
        return "" if all(find_spec(package) for package in self.packages) else self.install


FAMILIES = {
    "darknet": Family("darknet", ".weights", beside=".cfg"),
    "tf-ssd": Family("graphs.tensorflow", ".pb", classes="coco-91"),
    "caffe-ssd": Family("graphs.caffe", ".caffemodel", beside=".prototxt", classes="voc-20", resizable=False),
    "onnx": Family(
        "onnx_detector", ".onnx", packages=("onnx", "onnx2torch", "torchvision"), networks=("yolox", "ultralytics")
    ),
    "torchvision": Family("frameworks.torchvision_detector", packages=("torchvision",), networks=TORCHVISION),
    "transformers": Family(
        "frameworks.transformers_detector", folder=True, packages=("transformers", "torchvision"), named=True
    ),
    "torchscript": Family("frameworks.module_detector", ".torchscript"),
    "mmdet": Family(
        "frameworks.mmdet_detector",
        folder=True,
        packages=("mmdet", "mmengine", "mmcv"),
        install=MMDET_INSTALL,
        resizable=False,
    ),
    "synth": Family(
        "synth.card", ".safetensors", packages=("torchvision", "transformers"), resizable=False, named=True
    ),
}
