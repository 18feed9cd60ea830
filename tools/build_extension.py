"""Build the Blender extension: the add-on with rooms and wheels it needs inside, packed and checked by Blender's tool.

``python tools/build_extension.py [FOLDER]`` or ``make extension``; needs the bpy wheel for the tool.
"""

from __future__ import annotations

import base64
import hashlib
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from rauca_core.contract import RaucaError

ROOT = Path(__file__).resolve().parent.parent
CARRIED = (  # of rauca_core; the rest needs torch
    *("__init__.py", "version.py", "contract", "geometry"),
    *("runtime/__init__.py", "runtime/child_process.py", "runtime/folder_lock.py"),
)
UNUSED = (
    "detectors",
    "environment",
    "paper",
    "batteries",
    "camouflages",
    "preflight",
)  # assets of the rooms that are not carried
MANUAL = ("artists-guide", "glossary")  # pages of docs/ that the preferences open
PINNED = Path(__file__).with_name("extension_wheels.txt")
KEPT = ROOT / "build" / "wheels"
PYTHONS = ("3.11", "3.13")  # Blender 4.2 to 5.0, and from 5.1
PLATFORMS = ("manylinux2014_x86_64", "macosx_11_0_arm64", "macosx_11_0_x86_64")
OTHERS, OTHERS_VERSION, OTHERS_TAG = "rauca_other_pythons", "1", "py312.py314-none-any"
EPOCH = (1980, 1, 1, 0, 0, 0)  # the zip's own: the same bytes every time


def build_extension(out: Path) -> Path:
    """Write ``rauca-<version>.zip`` into ``out``; raises :class:`RaucaError` where Blender's tool refuses it."""
    import bpy

    scripts = Path(bpy.utils.system_resource("SCRIPTS"))
    tool = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="rauca-extension-") as temporary:
        source = Path(temporary) / "rauca"
        gather(source)
        carry_wheels(source, extension_wheels())
        command = [sys.executable, str(tool), "build", "--source-dir", str(source), "--output-dir", str(out)]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode:
        raise RaucaError(f"{ROOT / 'blender_addon'}: {' '.join((built.stdout + built.stderr).split())}")
    return max(out.glob("rauca-*.zip"), key=lambda path: path.stat().st_mtime)


def gather(source: Path) -> None:
    skip = shutil.ignore_patterns("__pycache__", "*.pyc", *UNUSED)
    shutil.copytree(ROOT / "blender_addon", source, ignore=skip)
    shutil.copytree(ROOT / "assets", source / "assets", ignore=skip)
    for name in CARRIED:
        origin, target = ROOT / "rauca_core" / name, source / "rauca_core" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if origin.is_dir():
            shutil.copytree(origin, target, ignore=skip)
        else:
            shutil.copy(origin, target)
    shutil.copy(ROOT / "LICENSE", source / "LICENSE")
    (source / "manual").mkdir()
    for name in MANUAL:
        lines = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8").splitlines(keepends=True)
        text = "".join(line for line in lines if not line.startswith("!["))  # pictures are not carried
        (source / "manual" / f"{name}.txt").write_text(text, encoding="utf-8")  # every system opens such a file


def carry_wheels(source: Path, wheels: list[Path]) -> None:
    """Copy wheels into the extension's folder and name them in its manifest.

    The manifest in the repository names none: a checkout has xatlas in its own Python.
    """
    (source / "wheels").mkdir()
    for wheel in wheels:
        shutil.copy(wheel, source / "wheels")
    wheels = [*wheels, write_other_pythons_wheel(source / "wheels")]
    manifest = source / "blender_manifest.toml"
    names = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
    head, table, tail = manifest.read_text(encoding="utf-8").partition("[permissions]")
    manifest.write_text(f"{head}wheels = [\n{names}]\n\n{table}{tail}", encoding="utf-8")


def extension_wheels() -> list[Path]:
    """The wheels to carry, one for each Python and platform: fetched by pip once and checked against the sums in the
    repository.

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


if __name__ == "__main__":
    built = build_extension(Path(sys.argv[1] if len(sys.argv) > 1 else "dist"))
    print(f"{built}: {built.stat().st_size / 2**20:.1f} MiB")
