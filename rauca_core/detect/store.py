"""The weights on this machine."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ..contract import RaucaError
from ..contract.assets import assets_folder
from ..contract.files import file_digest
from .catalogue import SOURCES, find_source
from .download import download, keep
from .sources import Source, WeightsFile

OWN_FOLDER = "RAUCA_WEIGHTS"  # environment: a folder of weights that were downloaded elsewhere


def weights_folder() -> Path:
    """Where fetched weights are kept: ``rauca/weights`` in the user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rauca" / "weights"


def stored_path(source: Source) -> Path:
    """Of the source's first file, the weights."""
    return weights_folder() / source.files[0].name


def stored_paths(source: Source) -> tuple[Path, ...]:
    """Of all its files, in its order."""
    return tuple(weights_folder() / file.name for file in source.files)


def shipped_path(source: Source) -> Path:
    """Where the weights of a detector of our own come with rauca."""
    return assets_folder() / "detectors" / f"{source.name}.safetensors"


def fetch(name: str, folder: Path | None = None) -> Path:
    """The path of the named weights, brought here if they are not yet; some come with rauca.

    Args:
        folder: looked through for the source's files, which may have any name as they are known by their sha256;
            the environment's ``RAUCA_WEIGHTS`` unless given. What is not there is downloaded.

    Raises:
        RaucaError: unknown name, weights that rauca cannot fetch (the message says how to get them), no such folder,
            no connection, or a file that is not what its sha256 promises.
    """
    source = find_source(name)
    if source.family == "synth" and shipped_path(source).is_file():
        return shipped_path(source)
    if not source.files:
        raise RaucaError(f"{name}: rauca does not fetch these weights; get them with: {source.how}")
    missing = [file for file in source.files if not _whole(file)]
    for file in source.files:
        if file not in missing:
            _verify_file(source, file)
    own = folder or (Path(os.environ[OWN_FOLDER]) if os.environ.get(OWN_FOLDER) else None)
    if own is not None:
        missing = [file for file in missing if not _take(source, file, own.expanduser())]
    if missing:
        download(name, missing, weights_folder())
    return stored_path(source)


def fetch_all(names: Iterable[str], folder: Path | None = None) -> tuple[dict[str, Path], dict[str, RaucaError]]:
    """:func:`fetch` of each name, going on after an error: what is here now, and why the others are not."""
    paths, errors = {}, {}
    for name in names:
        try:
            paths[name] = fetch(name, folder)
        except RaucaError as error:
            errors[name] = error
    return paths, errors


def _take(source: Source, file: WeightsFile, folder: Path) -> bool:
    """Copy ``file`` out of the user's folder if it is there under whatever name."""
    if not folder.is_dir():
        raise RaucaError(f"{folder}: not a folder; weights were to be looked for in it")
    for path in sorted(folder.iterdir()):
        if not path.is_file() or path.stat().st_size != (file.size_bytes or path.stat().st_size):
            continue
        if file_digest(path).startswith(file.sha256):
            with path.open("rb") as stream:
                keep(source.name, stream, file, weights_folder() / file.name)
            return True
    return False


def verify(source: Source) -> None:
    """Compare size and sha256 of stored weights with the source's; raises :class:`RaucaError` when they differ."""
    for file in source.files:
        _verify_file(source, file)


def _verify_file(source: Source, file: WeightsFile) -> None:
    path = weights_folder() / file.name
    if not path.is_file():
        raise RaucaError(f"{source.name}: not fetched yet; run `rauca weights fetch {source.name}`")
    found = path.stat().st_size
    if not _whole(file):
        raise RaucaError(
            f"{path}: expected {file.size_bytes} bytes, found {found}; run `rauca weights fetch {source.name}`"
        )
    if not file_digest(path).startswith(file.sha256):
        raise RaucaError(f"{path}: sha256 differs from the published weights; remove the file and fetch it again")


def _whole(file: WeightsFile) -> bool:
    path = weights_folder() / file.name
    return path.is_file() and path.stat().st_size == (file.size_bytes or path.stat().st_size)


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
    """What can be fetched, and whether it is here and whole (by size; loading checks the hash)."""
    return [_status(source) for source in SOURCES.values() if source.files]


def _status(source: Source) -> WeightsStatus:
    for file, path in zip(source.files, stored_paths(source), strict=True):
        if not path.is_file():
            return WeightsStatus(source, path, "not fetched")
        if not _whole(file):
            return WeightsStatus(source, path, f"{path.stat().st_size} bytes, expected {file.size_bytes}")
    return WeightsStatus(source, stored_path(source), "ready")
