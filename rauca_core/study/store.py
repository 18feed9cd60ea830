"""Stores: folders of artifacts, ``<kind>/<label>-<digest>`` each; of a run, or the user's cache."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..detect.weights import weights_folder
from .artifact import RECIPE, VERSIONS, Artifact
from .makers import KINDS


class Store:
    """A folder of artifacts, and others that are looked into for what is finished there.

    Attributes:
        folder: where artifacts are made.
        parents: only read.
    """

    def __init__(self, folder: Path, parents: Sequence[Path] = ()) -> None:
        self.folder = Path(folder)
        self.parents = tuple(dict.fromkeys(Path(parent) for parent in parents if Path(parent) != self.folder))

    def place(self, artifact: Artifact) -> Path:
        """Where an artifact lies in this store, or would; one that differs in the label alone is the same."""
        return artifact.place or _named(self.folder, artifact) or self.folder / artifact.kind / artifact.name

    def find(self, artifact: Artifact) -> Path | None:
        """The folder of a finished artifact, in this store or in a parent; None if it is still to be made."""
        if artifact.place is not None:
            return artifact.place
        for folder in (self.folder, *self.parents):
            found = _named(folder, artifact)
            if found is not None and KINDS[artifact.kind].has(artifact, found):
                with contextlib.suppress(OSError):
                    os.utime(found / RECIPE)  # `rauca cache prune` goes by the last use
                return found
        return None


def store_around(place: Path) -> list[Path]:
    """The store that a folder or a file lies in as an artifact; none if it lies elsewhere."""
    folder = Path(place).resolve()
    folder = folder if folder.is_dir() else folder.parent
    return [folder.parent.parent] if (folder / RECIPE).is_file() and folder.parent.name in VERSIONS else []


def link(path: Path, target: Path) -> None:
    """Let a folder of the store be found under a plain name, where the disk knows links."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aim = os.path.relpath(target.resolve(), path.parent.resolve())
    if path.is_symlink():
        if os.readlink(path) == aim:
            return
        path.unlink()
    with contextlib.suppress(OSError):
        path.symlink_to(aim, target_is_directory=True)


def user_cache() -> Path:
    """The store that all studies of this user look into, beside the weights of detectors."""
    return weights_folder().parent


@dataclass(frozen=True)
class Kept:
    """A folder or file in the cache; ``used`` is when it was last used, seconds since 1970."""

    kind: str
    path: Path
    size: int
    used: float


def kept_in(cache: Path) -> list[Kept]:
    """All that lies in a store, whatever its kind, the longest unused first."""
    return sorted(_kept(cache), key=lambda one: one.used)


def prune(cache: Path, kind: str | None = None, older_than_s: float = 0.0, max_bytes: int | None = None) -> list[Kept]:
    """Remove what was not used for some time, and then the longest unused until the rest is small enough.

    Args:
        kind: the only one to touch; without it everything but detectors' weights, which are fetched and not made.
        older_than_s: how long unused; 0 for no matter how long, unless ``max_bytes`` decides.

    Returns:
        What was removed.
    """
    kept = [one for one in kept_in(cache) if one.kind == kind or (kind is None and one.kind != "weights")]
    left, now, gone = sum(one.size for one in kept), time.time(), []
    for one in kept:
        old = older_than_s > 0 and now - one.used > older_than_s
        large = max_bytes is not None and left > max_bytes
        if old or large or (older_than_s == 0 and max_bytes is None):
            shutil.rmtree(one.path) if one.path.is_dir() else one.path.unlink()
            left -= one.size
            gone.append(one)
    return gone


def _named(folder: Path, artifact: Artifact) -> Path | None:
    return min((folder / artifact.kind).glob(f"*-{artifact.digest}"), default=None)


def _kept(cache: Path) -> Iterator[Kept]:
    for path in cache.glob("*/*"):
        files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
        recipe = path / RECIPE if (path / RECIPE).is_file() else path
        yield Kept(path.parent.name, path, sum(file.stat().st_size for file in files), recipe.stat().st_mtime)
