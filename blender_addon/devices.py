"""The devices that Cycles can render on, through Blender's own preferences, which are not saved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from .core import contract

BACKENDS = ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL")  # the first that has a device is taken


@dataclass(frozen=True)
class Device:
    """What Cycles renders on: a backend, or ``CPU``, and the devices it drives, all of which are used."""

    backend: str = "CPU"
    names: tuple[str, ...] = ()

    @property
    def described(self) -> str:
        """As a data set's plan records it: ``cpu``, or ``OPTIX: NVIDIA L4``."""
        return f"{self.backend}: {', '.join(self.names)}" if self.names else "cpu"


def gpus() -> list[Device]:
    """The GPUs that this Blender can use, by backend, best first; one GPU may appear under two backends."""
    preferences = _preferences()
    if preferences is None:
        return []
    found = []
    for backend in BACKENDS:
        names = tuple(d.name for d in preferences.get_devices_for_type(backend) if d.type == backend)
        if names:
            found.append(Device(backend, names))
    return found


def find(wanted: str) -> Device:
    """The device for ``cpu``, ``gpu`` or ``auto``; raises :class:`RaucaError` for a GPU where there is none."""
    there = gpus() if wanted != "cpu" else []
    if wanted == "gpu" and not there:
        raise contract.RaucaError(
            f"--render-device gpu: Blender {bpy.app.version_string} sees no GPU ({', '.join(BACKENDS)}); install its "
            "driver, or render on the CPU with --render-device cpu"
        )
    return there[0] if there else Device()


def use(scene: bpy.types.Scene, wanted: str, threads: int = 0) -> None:
    """Let ``scene`` be rendered on what :func:`find` finds; raises as it does.

    Args:
        threads: of the CPU; 0: as many as there are cores.
    """
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
    device = find(wanted)
    scene.cycles.device = "GPU" if device.names else "CPU"
    preferences = _preferences()
    if device.names and preferences is not None:
        preferences.compute_device_type = device.backend
        for entry in preferences.get_devices_for_type(device.backend):
            entry.use = entry.type == device.backend


def _preferences() -> Any:
    """Cycles' preferences; None in a Blender that was built without Cycles."""
    addon = bpy.context.preferences.addons.get("cycles")
    return addon.preferences if addon is not None else None
