"""The wheels that the Blender extension carries: fetched once by pip and checked against the sums in the repository."""

from __future__ import annotations

import base64
import hashlib
import re
import subprocess
import sys
import zipfile
from pathlib import Path

from rauca_core.contract import RaucaError

ROOT = Path(__file__).resolve().parent.parent
PINNED = Path(__file__).with_name("extension_wheels.txt")
KEPT = ROOT / "build" / "wheels"
PYTHONS = ("3.11", "3.13")  # Blender 4.2 to 5.0, and from 5.1
PLATFORMS = ("manylinux2014_x86_64", "macosx_11_0_arm64", "macosx_11_0_x86_64")
OTHERS, OTHERS_VERSION, OTHERS_TAG = "rauca_other_pythons", "1", "py312.py314-none-any"
EPOCH = (1980, 1, 1, 0, 0, 0)  # the zip's own: the same bytes every time


def extension_wheels() -> list[Path]:
    """The wheels, one for each Python and platform; fetched when the kept ones are not complete.

    Raises:
        RaucaError: pip cannot fetch them, or what it fetched is not what is pinned.
    """
    wanted = set(re.findall(r"sha256:([0-9a-f]{64})", PINNED.read_text(encoding="utf-8")))
    if wanted - _kept().keys():
        for python in PYTHONS:
            for platform in PLATFORMS:
                _fetch(python, platform)
    kept = _kept()
    if lacking := wanted - kept.keys():
        raise RaucaError(f"{PINNED}: {len(lacking)} of its wheels are not for {PLATFORMS}; pin those that are")
    return sorted(kept[checksum] for checksum in wanted)


def _kept() -> dict[str, Path]:
    return {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in KEPT.glob("*.whl")}


def _fetch(python: str, platform: str) -> None:
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
    command += ["--require-hashes", "--requirement", str(PINNED), "--dest", str(KEPT)]
    command += ["--python-version", python, "--platform", platform]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        reason = next((line for line in done.stderr.splitlines() if line.startswith("ERROR")), "no reason given")
        raise RaucaError(f"{PINNED}: pip cannot fetch the wheels for {python} on {platform} ({reason}); go online once")


def write_other_pythons_wheel(folder: Path) -> Path:
    """Write an empty wheel for the Pythons that xatlas has no wheel for into ``folder``; returns its path.

    Blender installs an extension only when its own Python is among those that the carried wheels name. Without xatlas
    the add-on unwraps by Blender's own means, and says so.
    """
    inside = f"{OTHERS}-{OTHERS_VERSION}.dist-info"
    files = {
        f"{inside}/METADATA": f"Metadata-Version: 2.1\nName: {OTHERS}\nVersion: {OTHERS_VERSION}\n"
        "Summary: Holds nothing\n",
        f"{inside}/WHEEL": "Wheel-Version: 1.0\nGenerator: rauca\nRoot-Is-Purelib: true\n"
        "Tag: py312-none-any\nTag: py314-none-any\n",
    }
    record = "".join(f"{name},{_sum(text)},{len(text)}\n" for name, text in files.items())
    files[f"{inside}/RECORD"] = f"{record}{inside}/RECORD,,\n"
    path = folder / f"{OTHERS}-{OTHERS_VERSION}-{OTHERS_TAG}.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        for name, text in files.items():
            wheel.writestr(zipfile.ZipInfo(name, EPOCH), text)
    return path


def _sum(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return "sha256=" + base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
