"""What a bare Linux lacks: libraries of the desktop that Blender's wheel links to, Python's `venv`, certificates.

``make demo`` and ``make test`` run this before anything else, with any Python 3. Root on Debian or Ubuntu gets the
missing packages installed, and is told so; everybody else gets the one line to run.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import ssl
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

PACKAGES: Mapping[str, str] = {
    "libX11.so.6": "libx11-6",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libXfixes.so.3": "libxfixes3",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
}
"""Library -> the package of Debian and Ubuntu that holds it."""
HAS_VENV = importlib.util.find_spec("ensurepip") is not None


def loads(library: str) -> bool:
    """Whether the dynamic linker finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def trusts_someone() -> bool:
    """Whether certificates of authorities are on this machine; without, no weights of a detector can be fetched."""
    paths = ssl.get_default_verify_paths()
    return paths.cafile is not None or (paths.capath is not None and any(Path(paths.capath).iterdir()))


def missing_packages(
    is_there: Callable[[str], bool] = loads, has_venv: bool = HAS_VENV, trusts: Callable[[], bool] = trusts_someone
) -> list[str]:
    """The packages whose library is not on this machine, Python's own part that Debian keeps in another package, and
    certificates."""
    venv = [] if has_venv else [f"python{sys.version_info.major}.{sys.version_info.minor}-venv"]
    certificates = [] if trusts() else ["ca-certificates"]
    return venv + certificates + [package for library, package in PACKAGES.items() if not is_there(library)]


def provide(missing: Sequence[str], may_install: bool, run: Callable[[Sequence[str]], int]) -> int:
    """Install packages, or say how to; 0 if all is there afterwards."""
    if not missing:
        return 0
    names = " ".join(missing)
    if not may_install:
        print(f"rauca needs packages that are not on this machine. Run this, then the same command again:\n\n"
              f"    sudo apt-get install --yes {names}\n", file=sys.stderr)  # fmt: skip
        return 1
    print(f"rauca needs packages that are not on this machine; installing {names} ...", flush=True)
    for command in (["apt-get", "update", "-qq"], ["apt-get", "install", "--yes", "-qq", *missing]):
        if run(command) != 0:
            print(f"error: `{' '.join(command)}` failed; install {names} yourself, then run again", file=sys.stderr)
            return 1
    return 0


def main() -> int:
    if sys.platform != "linux":
        return 0  # Blender's wheels for Windows and macOS bring what they need
    may_install = os.geteuid() == 0 and shutil.which("apt-get") is not None
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    return provide(missing_packages(), may_install, lambda command: subprocess.run(command, env=quiet).returncode)


if __name__ == "__main__":
    sys.exit(main())
