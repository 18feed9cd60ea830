"""Which detectors are ready, and what the others need."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from .catalogue import SOURCES
from .sources import Family, Source
from .store import shipped_path, status

# Packages an adapter imports beyond rauca's own requirements, each under the name it is imported by.
_PACKAGES: dict[Family, tuple[str, ...]] = {
    "onnx": ("onnx", "onnx2torch", "torchvision"),
    "torchvision": ("torchvision",),
    "transformers": ("transformers", "torchvision"),
    "mmdet": ("mmdet", "mmengine", "mmcv"),
    "synth": ("torchvision", "transformers"),
}


@dataclass(frozen=True)
class Listed:
    """One line of ``rauca detectors list``.

    Attributes:
        missing_package: the command that gets it; empty when nothing is missing.
        missing_weights: the command that gets them; empty when they are here.
    """

    source: Source
    missing_package: str
    missing_weights: str

    @property
    def ready(self) -> bool:
        return not (self.missing_package or self.missing_weights)

    @property
    def state(self) -> str:
        """``"ready"``, or what it needs."""
        needs = [what for what, how in (("package", self.missing_package), ("weights", self.missing_weights)) if how]
        return f"needs {' and '.join(needs)}" if needs else "ready"

    @property
    def remedies(self) -> list[str]:
        """Commands that get what is missing."""
        return [how for how in (self.missing_package, self.missing_weights) if how]


def listing() -> list[Listed]:
    """Every detector that has a name."""
    fetched = {entry.source.name for entry in status() if entry.ready}
    return [Listed(source, _missing_package(source), _missing_weights(source, fetched)) for source in SOURCES.values()]


def ready_names() -> list[str]:
    """Of the detectors that can be loaded by name alone, here and now."""
    return [entry.source.name for entry in listing() if entry.ready]


def _missing_package(source: Source) -> str:
    if all(find_spec(package) for package in _PACKAGES.get(source.family, ())):
        return ""
    if source.family == "mmdet":
        return "pip install openmim && mim install mmengine mmcv mmdet"
    return "pip install 'rauca[detectors]'"


def _missing_weights(source: Source, fetched: set[str]) -> str:
    if source.family == "synth":
        return "" if shipped_path(source).is_file() else source.how
    if source.files:
        return "" if source.name in fetched else f"rauca weights fetch {source.name}"
    return source.how
