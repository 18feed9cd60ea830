"""One small scene, built once: a painted box in the street."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import Plan, Quality, Ring, Weather


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Of values in [0, 1], dB."""
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


@pytest.fixture(scope="session")
def bpy_module():
    return pytest.importorskip("bpy", reason="the bpy wheel is not installed")


def small_plan(atlas_id: str, **changes: object) -> Plan:
    settings = {
        "name": "test",
        "vehicle_name": "box",
        "atlas_id": atlas_id,
        "size": 96,
        "quality": Quality(8),
        "light": True,
        "weathers": (Weather("day", 45.0),),
        "ring": Ring((30.0, 200.0), (15.0,), (7.0,)),
        "locations": 1,
        "reference_srgb": (140, 140, 140),
        "min_visible": 0.5,
        "seed": 3,
        "blender": "test",
    }
    return Plan(**(settings | changes))


@pytest.fixture
def session(bpy_module, box_vehicle):
    from blender_addon.scene.session import Session

    bpy_module.ops.wm.read_factory_settings(use_empty=True)
    built = Session(small_plan(box_vehicle.atlas_id), box_vehicle)
    built.enter(0)
    built.set_weather(built.plan.weathers[0])
    return built


@pytest.fixture
def empty_scene() -> bool:
    """Whether tests of the add-on begin in an empty scene, or in Blender's own of a cube, a lamp and a camera."""
    return True


@pytest.fixture
def addon(bpy_module, empty_scene):
    """Blender with the add-on enabled; yields ``bpy``."""
    import blender_addon

    bpy_module.ops.wm.read_factory_settings(use_empty=empty_scene)
    blender_addon.register()
    bpy_module.context.preferences.addons.new().module = blender_addon.__name__
    yield bpy_module
    addons = bpy_module.context.preferences.addons
    if enabled := addons.get(blender_addon.__name__):  # a test may have loaded other preferences
        addons.remove(enabled)
    blender_addon.unregister()
    assert not hasattr(bpy_module.types.Scene, "rauca")


@pytest.fixture
def named_in_german(bpy_module, monkeypatch):
    """New nodes have the names that Blender gives them where new data is named in German."""
    from blender_addon.scene import nodes

    def named(tree, kind, _add=nodes.add, **inputs):
        node = _add(tree, kind, **inputs)
        node.name = f"Knoten {len(tree.nodes)}"
        return node

    monkeypatch.setattr(nodes, "add", named)


@pytest.fixture
def small_disk() -> Iterator[Path]:
    """A disk of 3 MB, mounted where only a process of its own sees it, which every process may go through."""
    mount = "mount -t tmpfs -o size=3m tmpfs /mnt && echo mounted && exec sleep 1000"
    command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", mount]
    try:
        keeper = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    except FileNotFoundError:
        pytest.skip("this system has no unshare")
    with keeper:
        if not keeper.stdout.readline():
            pytest.skip("this user may not mount a disk")
        yield Path(f"/proc/{keeper.pid}/root/mnt")
        keeper.kill()
