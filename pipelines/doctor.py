"""What this machine has, what is missing and how to get it."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rauca_core.detect import SOURCES, status
from rauca_core.runtime.blender import libraries_for
from rauca_core.version import __version__

PACKAGES = ("numpy", "numba", "xatlas", "opencv-contrib-python-headless", "faster-coco-eval", "safetensors")
BLENDER_PROBE = """
import bpy
from blender_addon import compat, devices
gpus = [gpu.described for gpu in devices.gpus()]
print("version", bpy.app.version_string, "denoiser" if compat.has_denoiser() else "no-denoiser")
print("renders on", "; ".join(["cpu", *gpus]))
"""


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report; ``remedy`` says what to do when not ``ok``."""

    what: str
    found: str
    ok: bool = True
    remedy: str = ""


def findings() -> Iterator[Finding]:
    """Look at everything in turn."""
    yield Finding("rauca", __version__)
    supported = sys.version_info >= (3, 11)
    yield Finding("python", platform.python_version(), supported, "use Python 3.11 or newer")
    yield Finding("cores", str(os.cpu_count()))
    free = shutil.disk_usage(Path.cwd()).free / 2**30
    yield Finding("free disk here", f"{free:.0f} GiB", free > 5, "the demo needs about 5 GiB with its packages")
    yield _torch()
    yield from (_package(name) for name in PACKAGES)
    yield from _blender()
    for name, state in status().items():
        optional = not SOURCES[name].standard and state == "not fetched"
        yield Finding(f"weights {name}", state, state == "ready" or optional, f"rauca weights fetch {name}")


def _torch() -> Finding:
    try:
        import torch
    except ImportError as error:
        return Finding("torch", str(error), False, "pip install torch==2.13.0")
    devices = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
    if torch.backends.mps.is_available():
        devices.append("mps")
    return Finding("torch", f"{torch.__version__} on {', '.join(devices) or 'cpu'}")


def _package(name: str) -> Finding:
    try:
        return Finding(name, importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        return Finding(name, "missing", False, f"pip install {name}")


def _blender() -> Iterator[Finding]:
    """Ask the bpy wheel in a process of its own: a missing system library would otherwise take the doctor down."""
    probe = subprocess.run([sys.executable, "-c", BLENDER_PROBE], capture_output=True, text=True, check=False)
    answer = next((line.split() for line in probe.stdout.splitlines() if line.startswith("version ")), None)
    if answer is None:
        reason = (probe.stderr.strip().splitlines() or ["no message"])[-1]
        yield Finding("bpy", reason, False, libraries_for(reason) or "pip install rauca[dataset]")
        return
    yield Finding("bpy", " ".join(answer[1:-1]))
    devices = next((line for line in probe.stdout.splitlines() if line.startswith("renders on ")), "renders on cpu")
    yield Finding("Cycles renders on", devices.removeprefix("renders on "))
    denoises = answer[-1] == "denoiser"
    yield Finding("denoiser", "Open Image Denoise" if denoises else "none", denoises, "use the bpy wheel")
