"""A camouflage as an asset: made in one file, saved, and worn by a vehicle of another one."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from blender_addon.scene.camera import place
from blender_addon.scene.render import prepare, render_linear
from blender_addon.scene.vehicle import load_shipped
from blender_addon.steps.camouflage import assets, panel
from blender_addon.steps.camouflage.painted_vehicle import painted_surface
from rauca_core.contract import Quality, load_camouflage
from tests.blender.round_trip import daylight, look_around

from .conftest import refusal
from .painted_box import a_box, a_camouflage, noise, painted_box

GREEN = np.full((8, 8, 3), (0, 255, 0), np.uint8)


@pytest.fixture
def rauca(addon):
    """The scene's settings, in an empty scene."""
    return addon.context.scene.rauca


def the_asset() -> bpy.types.NodeTree:
    (asset,) = [tree for tree in bpy.data.node_groups if tree.asset_data is not None]
    return asset


def saved(path: Path) -> Path:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def empty_file() -> None:
    """Another file, with the add-on; the factory's settings would disable it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True, load_ui=False)


def an_asset_of_the_sedan(folder: Path) -> Path:
    """A .blend whose sedan wears spots, an asset."""
    a_camouflage(folder, GREEN, load_shipped("sedan").atlas_id, "sedan")
    bpy.ops.rauca.apply_camouflage()
    assert bpy.ops.rauca.mark_asset() == {"FINISHED"}
    return saved(folder / "spots.blend")


def greenest() -> float:
    """Share of the vehicle's pixels that are green, of a render from its side."""
    scene = bpy.context.scene
    surface, _ = painted_surface(bpy.context)
    daylight(scene)
    prepare(scene)
    scene.render.film_transparent = True
    place(scene, look_around(surface, 48, 60.0)[0])
    rgba = render_linear(scene, Quality(4, denoise=False), seed=1)
    seen = rgba[rgba[..., 3] > 0.5]
    return float((seen[:, 1] > 2 * seen[:, 0]).mean())


def test_an_asset_has_a_picture_and_names_its_vehicle_and_survives_saving(rauca, tmp_path):
    painted_box(tmp_path)
    state = panel.state(bpy.context)
    assert bpy.ops.rauca.mark_asset() == {"FINISHED"}
    assert panel.state(bpy.context) == state
    bpy.ops.wm.open_mainfile(filepath=str(saved(tmp_path / "car.blend")))
    assert panel.state(bpy.context) == state
    asset = the_asset()
    assert asset.name == "spots (Box)"
    assert asset.asset_data.description == "Camouflage spots for Box"
    assert {tag.name for tag in asset.asset_data.tags} == {"rauca camouflage", "Box"}
    assert tuple(asset.preview.image_size) == (64, 64)
    shown = np.array(asset.preview.image_pixels_float[:]).reshape(64, 64, 4)[::-1, :, :3]
    assert np.abs(shown - noise() / 255).max() < 0.01
    assert "asset of this file already" in refusal(bpy.ops.rauca.mark_asset)


def test_a_large_maps_picture_is_its_mean(rauca, tmp_path):
    a_box()
    a_camouflage(tmp_path, np.kron(noise(128), np.ones((4, 4, 1), np.uint8)))
    bpy.ops.rauca.apply_camouflage()
    bpy.ops.rauca.mark_asset()
    assert tuple(the_asset().preview.image_size) == (256, 256)
    shown = np.array(the_asset().preview.image_pixels_float[:]).reshape(256, 256, 4)[::-1, :, :3]
    assert np.abs(shown[::2, ::2] - noise(128) / 255).max() < 0.01


def test_the_asset_stays_when_the_camouflage_is_taken_off_and_looks_never_touch_it(rauca, tmp_path):
    painted_box(tmp_path)
    bpy.ops.ed.undo_push(message="painted")
    assert bpy.ops.rauca.mark_asset("EXEC_DEFAULT", True) == {"FINISHED"}
    rauca = bpy.context.scene.rauca
    bpy.ops.rauca.show_paint(which="ORIGINAL")
    assert round(the_asset().nodes["shown"].outputs[0].default_value) == 1
    bpy.ops.rauca.remove_camouflage()
    assert rauca.camouflage.coat is None
    assert the_asset().nodes["camouflage"].image.packed_file is not None
    assert bpy.ops.rauca.apply_asset(group=the_asset().name) == {"FINISHED"}
    assert panel.state(bpy.context).words == "The vehicle wears spots"
    assert "asset of this file already" in refusal(bpy.ops.rauca.mark_asset)
    the_asset().asset_clear()
    assert bpy.ops.rauca.mark_asset() == {"FINISHED"}


def test_undo_takes_the_asset_back(rauca, tmp_path):
    painted_box(tmp_path)
    bpy.ops.ed.undo_push(message="painted")
    bpy.ops.rauca.mark_asset("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    assert not [tree for tree in bpy.data.node_groups if tree.asset_data is not None]


def test_an_empty_file_gets_the_vehicle_in_the_camouflage(rauca, tmp_path):
    blend = an_asset_of_the_sedan(tmp_path)
    empty_file()
    assert bpy.ops.rauca.apply_asset(blend=str(blend), group="spots (sedan)") == {"FINISHED"}
    settings = bpy.context.scene.rauca
    assert settings.vehicle.object.name == "sedan"
    assert panel.state(bpy.context).words == "The vehicle wears spots"
    assert not [tree for tree in bpy.data.node_groups if tree.asset_data is not None]  # nothing else came
    made, png = load_camouflage(Path(settings.camouflage.file))  # which step 7 judges
    assert (made.name, made.vehicle_name, made.atlas_id) == ("spots", "sedan", load_shipped("sedan").atlas_id)
    assert png.is_file()
    assert greenest() > 0.3
    bpy.ops.rauca.show_paint(which="ORIGINAL")
    assert greenest() < 0.02


def test_texels_are_the_same_after_the_way_through_an_asset(rauca, tmp_path):
    painted_box(tmp_path)
    bpy.ops.rauca.mark_asset()
    before = Path(rauca.camouflage.file).with_suffix(".png").read_bytes()
    bpy.ops.wm.open_mainfile(filepath=str(saved(tmp_path / "car.blend")))
    bpy.ops.rauca.apply_asset(group="spots (Box)")
    after = Path(bpy.context.scene.rauca.camouflage.file).with_suffix(".png")
    assert after.read_bytes() == before


def test_the_appended_group_shows_without_the_add_on(rauca, tmp_path):
    """As a node in the shader editor: on a vehicle that was never painted, between its UVs and its shader."""
    blend = an_asset_of_the_sedan(tmp_path)
    empty_file()
    bpy.ops.rauca.add_vehicle(vehicle="sedan")
    with bpy.data.libraries.load(str(blend), link=False) as (_, wanted):
        wanted.node_groups = ["spots (sedan)"]
    material = next(m for m in bpy.context.object.data.materials if m["rauca_class"] == "paint")
    tree = material.node_tree
    group, uv = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeUVMap")
    group.node_tree, uv.uv_map = wanted.node_groups[0], "rauca"
    tree.links.new(uv.outputs[0], group.inputs["Atlas UV"])
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(group.outputs["Color"], shader.inputs["Base Color"])
    scene = bpy.context.scene
    daylight(scene)
    prepare(scene)
    scene.render.film_transparent = True
    place(scene, look_around(SimpleNamespace(soup=load_shipped("sedan")), 48, 60.0)[0])
    rgba = render_linear(scene, Quality(4, denoise=False), seed=1)
    seen = rgba[rgba[..., 3] > 0.5]
    assert (seen[:, 1] > 2 * seen[:, 0]).mean() > 0.3


def test_what_does_not_fit_or_is_not_there_is_refused_and_nothing_changes(rauca, tmp_path):
    blend = an_asset_of_the_sedan(tmp_path)
    empty_file()
    a_box()
    chosen = bpy.context.scene.rauca.camouflage.file = "before.json"
    apply = bpy.ops.rauca.apply_asset
    assert "made for sedan in another UV layout" in refusal(apply, blend=str(blend), group="spots (sedan)")
    assert "has no node group dots" in refusal(apply, blend=str(blend), group="dots")
    assert "cannot be read" in refusal(apply, blend=str(tmp_path / "none.blend"), group="dots")
    (tmp_path / "cut.blend").write_bytes(blend.read_bytes()[:100])
    assert "cannot be read" in refusal(apply, blend=str(tmp_path / "cut.blend"), group="dots")
    bpy.data.node_groups.new("plain", "ShaderNodeTree")
    assert "holds no camouflage" in refusal(apply, group="plain")
    assert "no node group of this file" in refusal(apply, group="gone")
    assert bpy.context.scene.rauca.camouflage.file == chosen
    assert [tree.name for tree in bpy.data.node_groups] == ["plain"]
    assert not bpy.data.images


def test_a_vehicle_that_changed_since_or_wears_nothing_makes_no_asset(rauca, tmp_path):
    assert "Apply a camouflage first" in refusal(bpy.ops.rauca.mark_asset)
    box = painted_box(tmp_path)
    bpy.data.objects.remove(box)
    assert "No vehicle" in refusal(bpy.ops.rauca.mark_asset)
    assert not [tree for tree in bpy.data.node_groups if tree.asset_data is not None]


def test_the_asset_browsers_menu_offers_it_for_camouflages_alone(rauca, tmp_path):
    painted_box(tmp_path)
    bpy.ops.rauca.mark_asset()
    buttons = []

    def operator(name, **more):
        buttons.append(SimpleNamespace(name=name))
        return buttons[-1]

    def show(asset):
        menu = SimpleNamespace(layout=SimpleNamespace(separator=lambda: None, operator=operator))
        for callback in bpy.types.ASSETBROWSER_MT_context_menu._dyn_ui_initialize():
            if callback.__module__ == assets.__name__:
                callback(menu, SimpleNamespace(asset=asset))

    tree = the_asset()
    entry = {"name": tree.name, "id_type": "NODETREE", "metadata": tree.asset_data}
    show(None)
    show(SimpleNamespace(**{**entry, "id_type": "MATERIAL"}, local_id=None, full_library_path="/a.blend"))
    show(SimpleNamespace(**{**entry, "metadata": SimpleNamespace(tags={})}, local_id=tree, full_library_path=""))
    assert buttons == []
    show(SimpleNamespace(**entry, local_id=tree, full_library_path=""))
    show(SimpleNamespace(**entry, local_id=None, full_library_path="/a.blend"))
    assert [(found.name, found.group, found.blend) for found in buttons] == [
        ("rauca.apply_asset", "spots (Box)", ""),
        ("rauca.apply_asset", "spots (Box)", "/a.blend"),
    ]
