"""One click gives a scene in which all is ready; a vehicle comes from Blender's own menu, a camouflage by drop."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np

from blender_addon.jobs import pictures
from blender_addon.scene.vehicle import load_shipped, shipped_names
from blender_addon.steps import dataset
from blender_addon.steps.camouflage import drop, panel
from blender_addon.steps.vehicle import add_menu
from blender_addon.steps.vehicle.panel import state as vehicle_state
from rauca_core.contract.files import png_bytes

from .conftest import refusal
from .painted_box import a_box, a_camouflage


def test_the_demo_scene_is_ready_for_every_step_and_leaves_the_artists_own(addon, tmp_path):
    own = addon.context.scene
    a_box()
    assert bpy.ops.rauca.demo_scene() == {"FINISHED"}
    scene = bpy.context.scene
    assert scene != own
    assert own.rauca.vehicle.object.name == "Box"
    assert vehicle_state(bpy.context).kind == "done"
    steps = scene.rauca
    assert steps.weather.shown.on
    assert steps.weather.street is not None
    assert scene.camera == steps.cameras.camera
    job = dataset.dataset_job(bpy.context, tmp_path, tmp_path / "vehicle")
    assert len(job.plan.frames()) == 12
    assert job.plan.light
    assert "Choose" not in dataset.state(bpy.context).words
    assert all(getattr(steps, name).folder for name in ("dataset", "optimize", "evaluate", "bake"))
    assert bpy.ops.rauca.demo_scene() == {"FINISHED"}  # once more beside it
    assert bpy.context.scene not in (scene, own)


def test_blenders_add_menu_has_vehicles(addon):
    drawn = []
    layout = SimpleNamespace(menu=lambda *given, **more: drawn.append(given))
    menu = SimpleNamespace(layout=layout)
    for callback in bpy.types.VIEW3D_MT_mesh_add._dyn_ui_initialize():
        if callback.__module__ == add_menu.__name__:
            callback(menu, SimpleNamespace(mode="OBJECT"))
            callback(menu, SimpleNamespace(mode="EDIT_MESH"))
    assert drawn == [("RAUCA_MT_vehicles",)]


class Grid:
    """A menu's layout: notes the pictures by their icons, and each button's choice, column by column."""

    def __init__(self) -> None:
        self.icons: list[int] = []
        self.tops: list[int] = []  # the number of each column's first button
        self.buttons: list[tuple[str, SimpleNamespace]] = []

    def row(self):
        return self

    def column(self):
        self.tops.append(len(self.buttons))
        return self

    def template_icon(self, icon, scale):
        self.icons.append(icon)

    def operator(self, name, text, **more):
        self.buttons.append((text, SimpleNamespace()))
        return self.buttons[-1][1]


def test_the_menu_shows_a_picture_of_every_shipped_vehicle(addon):
    grid = Grid()
    add_menu.RAUCA_MT_vehicles.draw(SimpleNamespace(layout=grid), bpy.context)
    assert {button.vehicle for _, button in grid.buttons} == set(shipped_names())
    # Blender sets what a menu holds by columns: read across, cars come first.
    assert [grid.buttons[top][0] for top in grid.tops[:4]] == ["Hatchback", "Sedan", "SUV", "Van"]
    assert len(grid.icons) == len(grid.buttons)
    for name in shipped_names():
        picture = pictures.shown(f"vehicle.{name}")
        width, height = picture.image_size
        assert 64 <= width == height <= 128
        rgba = np.array(picture.image_pixels_float[:]).reshape(height, width, 4)
        assert rgba[..., :3].std() > 0.05, name  # a vehicle before a ground, not one grey


def test_a_dropped_camouflage_is_put_on_and_can_be_undone(addon, tmp_path):
    a_box()
    path = a_camouflage(tmp_path)
    bpy.context.scene.rauca.camouflage.file = ""
    bpy.ops.ed.undo_push(message="before")
    for suffix in (".json", ".png"):
        dropped = str(path.with_suffix(suffix))
        assert bpy.ops.rauca.drop_camouflage("EXEC_DEFAULT", True, filepath=dropped) == {"FINISHED"}
        assert panel.state(bpy.context).words == "The vehicle wears spots"
        bpy.ops.ed.undo()
        assert bpy.context.scene.rauca.camouflage.coat is None


def test_a_dropped_camouflage_brings_its_vehicle(addon, tmp_path):
    path = a_camouflage(tmp_path, atlas_id=load_shipped("sedan").atlas_id, vehicle="sedan")
    assert bpy.ops.rauca.drop_camouflage(filepath=str(path)) == {"FINISHED"}
    assert bpy.context.scene.rauca.vehicle.object.name == "sedan"


def test_another_file_dropped_is_told_or_left_to_blender(addon, tmp_path):
    a_box()
    (tmp_path / "notes.json").write_text("{}")
    assert "notes.json" in refusal(bpy.ops.rauca.drop_camouflage, filepath=str(tmp_path / "notes.json"))
    assert bpy.context.scene.rauca.camouflage.file == ""
    (tmp_path / "holiday.png").write_bytes(png_bytes(np.zeros((8, 8, 3), np.uint8)))
    things = set(bpy.context.scene.objects)
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.rauca.drop_camouflage(filepath=str(tmp_path / "holiday.png"))
    (added,) = set(bpy.context.scene.objects) - things
    assert added.type == "EMPTY"
    assert added.data.filepath.endswith("holiday.png")


def test_only_the_viewport_in_object_mode_takes_drops(addon):
    poll = drop.RAUCA_FH_camouflage.poll_drop
    area = SimpleNamespace(type="VIEW_3D")
    assert poll(SimpleNamespace(area=area, mode="OBJECT"))
    assert not poll(SimpleNamespace(area=area, mode="EDIT_MESH"))
    assert not poll(SimpleNamespace(area=SimpleNamespace(type="IMAGE_EDITOR"), mode="OBJECT"))
    assert not poll(SimpleNamespace(area=None, mode="OBJECT"))
