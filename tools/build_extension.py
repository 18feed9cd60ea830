"""Build the Blender extension: the add-on with rooms and wheels it needs inside, packed and checked by Blender's tool.

``python tools/build_extension.py [FOLDER]`` or ``make extension``; needs the bpy wheel for the tool.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

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


def build_extension(out: Path) -> Path:
    """Write ``rauca-<version>.zip`` into ``out``; raises :class:`RaucaError` where Blender's tool refuses it."""
    import bpy

    from rauca_core.contract import RaucaError
    from tools.extension_wheels import extension_wheels

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


def carry_wheels(source: Path, wheels: list[Path]) -> None:
    """Copy wheels into the extension's folder and name them in its manifest.

    The manifest in the repository names none: a checkout has xatlas in its own Python.
    """
    from tools.extension_wheels import write_other_pythons_wheel

    (source / "wheels").mkdir()
    for wheel in wheels:
        shutil.copy(wheel, source / "wheels")
    wheels = [*wheels, write_other_pythons_wheel(source / "wheels")]
    manifest = source / "blender_manifest.toml"
    names = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
    head, table, tail = manifest.read_text(encoding="utf-8").partition("[permissions]")
    manifest.write_text(f"{head}wheels = [\n{names}]\n\n{table}{tail}", encoding="utf-8")


if __name__ == "__main__":
    built = build_extension(Path(sys.argv[1] if len(sys.argv) > 1 else "dist"))
    print(f"{built}: {built.stat().st_size / 2**20:.1f} MiB")
