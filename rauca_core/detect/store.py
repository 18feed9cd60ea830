"""The weights on this machine."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ..contract import RaucaError
from .download import download
from .sources import SOURCES, Source, find_source
from .weights_file import sha256_of


def weights_folder() -> Path:
    """Where fetched weights are kept: ``rauca/weights`` in the user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rauca" / "weights"


def stored_path(source: Source) -> Path:
    return weights_folder() / f"{source.name}.weights"


def fetch(name: str) -> Path:
    """The path of the named weights, downloaded if they are not here yet.

    Raises:
        RaucaError: unknown name, no connection, or a file that is not what its sha256 promises.
    """
    source = find_source(name)
    path = stored_path(source)
    if path.is_file() and path.stat().st_size == source.size_bytes:
        verify(source, path)
    else:
        download(source, path)
    return path


def verify(source: Source, path: Path) -> None:
    """Compare size and sha256 of stored weights with the source's; raises :class:`RaucaError` when they differ."""
    if not path.is_file():
        raise RaucaError(f"{source.name}: not fetched yet; run `rauca weights fetch {source.name}`")
    found = path.stat().st_size
    if found != source.size_bytes:
        raise RaucaError(
            f"{path}: expected {source.size_bytes} bytes, found {found}; run `rauca weights fetch {source.name}`"
        )
    if sha256_of(path) != source.sha256:
        raise RaucaError(f"{path}: sha256 differs from the published weights; remove the file and fetch it again")


@dataclass(frozen=True)
class WeightsStatus:
    """One line of ``rauca weights list``; ``state`` is ``"ready"``, ``"not fetched"`` or what is wrong."""

    source: Source
    path: Path
    state: str

    @property
    def ready(self) -> bool:
        return self.state == "ready"


def status() -> list[WeightsStatus]:
    """Every named source and whether its weights are here and whole (by size; loading checks the hash)."""
    return [_status(source, stored_path(source)) for source in SOURCES.values()]


def _status(source: Source, path: Path) -> WeightsStatus:
    if not path.is_file():
        return WeightsStatus(source, path, "not fetched")
    found = path.stat().st_size
    whole = found == source.size_bytes
    return WeightsStatus(source, path, "ready" if whole else f"{found} bytes, expected {source.size_bytes}")
