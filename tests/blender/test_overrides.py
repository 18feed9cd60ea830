"""Settings overridden and restored; what was overridden is a line of text in a .blend that anybody may have written."""

from __future__ import annotations

import json

import bpy
import pytest

from blender_addon.scene.overrides import override, restore

VALUES = {"cycles.film_exposure": 2.0, "render.resolution_x": 64, "view_settings.view_transform": "Raw"}


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def settings(scene):
    return scene.cycles.film_exposure, scene.render.resolution_x, scene.view_settings.view_transform


def test_all_is_restored_but_what_the_artist_changed(scene):
    before = settings(scene)
    overrides = override(scene, override(scene, "", VALUES), {"cycles.film_exposure": 3.0, "render.no_such_setting": 1})
    assert settings(scene) == (3.0, 64, "Raw")
    restore(scene, overrides)
    assert settings(scene) == before

    overrides = override(scene, "", VALUES)
    scene.render.resolution_x = 77
    restore(scene, overrides)
    assert settings(scene) == (before[0], 77, before[2])


def test_a_damaged_override_is_made_anew(scene):
    before = settings(scene)
    restore(scene, override(scene, json.dumps({"render.resolution_x": ["wide", before[1]]}), VALUES))
    assert settings(scene) == before


@pytest.mark.parametrize(
    "overrides",
    [
        "{",
        "[" * 100_000,
        "[]",
        json.dumps({"render.resolution_x": 5, "render.resolution_y": [1]}),
        json.dumps({"render.resolution_x": ["wide", 1920]}),
        json.dumps({"render.resolution_x.": [1, 1920], "": [1, 2], "name": [1, "Scene"]}),
        json.dumps({"view_settings.view_transform": ["No such", "AgX"], "render.resolution_x": [10**30, 1920]}),
        json.dumps({"__class__": [1, 2], "bl_rna.name": ["x", "Scene"], "copy": [1, 2]}),
    ],
)
def test_what_is_no_note_of_overrides_changes_nothing(scene, overrides):
    before = settings(scene)
    restore(scene, overrides)
    assert (settings(scene), scene.name) == (before, "Scene")
