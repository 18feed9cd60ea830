"""What runs inside Blender, and a small scene of it, a painted box in the street. Without bpy the folder is skipped."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike

pytest.importorskip("bpy", reason="the bpy wheel is not installed")

import bpy

import blender_addon
from blender_addon.scene import nodes
from blender_addon.scene.session import Session
from rauca_core.contract import Plan, Quality, RaucaError, Ring, Vehicle, Weather

_ended: list[int] = []


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    _ended.append(int(exitstatus))


def pytest_unconfigure(config: pytest.Config) -> None:
    """End at once: bpy 4.5 that has read another .blend waits for ever in a destructor of its own."""
    if _ended and bpy.app.version < (5, 0, 0):
        sys.stdout.flush()
        os._exit(_ended[-1])


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Of values in [0, 1], dB."""
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


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


def refusal(call: Callable[..., object], *given: object, **more: object) -> str:
    """The words in which an operator, or what it calls, refuses to work; the window knows no options."""
    with pytest.raises((RaucaError, RuntimeError)) as told:
        call(*given, **more)
    assert told.type is RuntimeError or "\n" not in str(told.value)  # Blender breaks the lines of a report
    words = " ".join(str(told.value).split())
    assert "--" not in words
    return words


def mesh_object(name: str, corners: ArrayLike, faces: Sequence[Sequence[int]], *materials: str) -> bpy.types.Object:
    """A new object that no scene has yet; of its materials those are made that are not there."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(corners).tolist(), [], faces)
    for material in materials:
        mesh.materials.append(bpy.data.materials.get(material) or bpy.data.materials.new(material))
    return bpy.data.objects.new(name, mesh)


def small_session(vehicle: Vehicle, **changes: object) -> Session:
    """In an empty Blender; its plan is the small one with ``changes``."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return Session(small_plan(vehicle.atlas_id, **changes), vehicle)


@pytest.fixture
def session(box_vehicle):
    built = small_session(box_vehicle)
    built.enter(0)
    built.set_weather(built.plan.weathers[0])
    return built


@pytest.fixture
def empty_scene() -> bool:
    """Whether tests of the add-on begin in an empty scene, or in Blender's own of a cube, a lamp and a camera."""
    return True


@pytest.fixture
def addon(empty_scene):
    """Blender with the add-on enabled; yields ``bpy``."""
    bpy.ops.wm.read_factory_settings(use_empty=empty_scene)
    blender_addon.register()
    bpy.context.preferences.addons.new().module = blender_addon.__name__
    yield bpy
    addons = bpy.context.preferences.addons
    if enabled := addons.get(blender_addon.__name__):  # a test may have loaded other preferences
        addons.remove(enabled)
    blender_addon.unregister()
    assert not hasattr(bpy.types.Scene, "rauca")


@pytest.fixture
def named_in_german(monkeypatch):
    """New nodes have the names that Blender gives them where new data is named in German."""

    def named(tree, kind, _add=nodes.add, **inputs):
        node = _add(tree, kind, **inputs)
        node.name = f"Knoten {len(tree.nodes)}"
        return node

    monkeypatch.setattr(nodes, "add", named)
