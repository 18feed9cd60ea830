"""The add-on inside Blender: it registers, its buttons work, Blender's own tool accepts it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import Camouflage, Dataset, load_vehicle, save_camouflage
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import png_bytes
from rauca_core.runtime.images import read_image

REPOSITORY = Path(__file__).resolve().parent.parent.parent


@pytest.fixture
def addon(bpy_module):
    import blender_addon

    bpy_module.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    bpy_module.context.scene.rauca.vehicle.origin = "FILE"
    yield bpy_module
    blender_addon.unregister()
    assert not hasattr(bpy_module.types.Scene, "rauca")


def a_camouflage(folder: Path, atlas_id: str) -> Path:
    uv_map = np.full((32, 32, 3), (200, 30, 60), np.uint8)
    save_camouflage(folder / "c.json", Camouflage("pink", "sedan", atlas_id, 32, "plain"), png_bytes(uv_map))
    return folder / "c.json"


def test_apply_adds_the_painted_vehicle(addon, tmp_path):
    vehicle = load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)
    settings = addon.context.scene.rauca
    settings.camouflage.file = str(a_camouflage(tmp_path, vehicle.atlas_id))
    assert addon.ops.rauca.apply_camouflage() == {"FINISHED"}
    painted = addon.data.objects["sedan"]
    assert len(painted.data.polygons) == len(vehicle.triangles)
    assert settings.camouflage.coat.nodes["camouflage"].image.packed_file is not None


def test_apply_refuses_another_atlas_and_changes_nothing(addon, tmp_path):
    before = len(addon.data.objects)
    addon.context.scene.rauca.camouflage.file = str(a_camouflage(tmp_path, "0" * 16))
    with pytest.raises(RuntimeError, match="made for the UV atlas 0000000000000000"):
        addon.ops.rauca.apply_camouflage()
    assert len(addon.data.objects) == before


def test_generate_dataset_runs_the_headless_job(addon, tmp_path):
    settings = addon.context.scene.rauca
    settings.weather.preset, settings.cameras.azimuths = "demo", 1
    settings.dataset.size, settings.dataset.samples = 64, 1
    with pytest.raises(RuntimeError, match="Choose a folder"):
        addon.ops.rauca.generate_dataset()
    settings.dataset.folder = str(tmp_path / "set")
    assert addon.ops.rauca.generate_dataset() == {"FINISHED"}
    assert len(Dataset(tmp_path / "set").frames()) == 1 * 2 * 2 * 3
    settings.dataset.size = 96
    with pytest.raises(RuntimeError, match="holds a dataset made with another size"):
        addon.ops.rauca.generate_dataset()


def test_blenders_own_tool_accepts_the_manifest(bpy_module):
    scripts = Path(bpy_module.utils.system_resource("SCRIPTS"))
    tool = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    checked = subprocess.run(
        [sys.executable, str(tool), "validate", str(REPOSITORY / "blender_addon")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
