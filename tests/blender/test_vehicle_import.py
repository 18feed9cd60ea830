"""Vehicles from files: what is read, what is told, and that a bad file leaves one sentence and no trace."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest
import trimesh

from blender_addon.scene.images import read_image_blender
from blender_addon.scene.uvs import smart_project
from blender_addon.scene.vehicle_files import import_vehicle
from rauca_core.contract import RaucaError
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import png_bytes
from tests.atlas_report import atlas_report
from tests.blender.conftest import mesh_object

CORNERS = np.array([(x, y, z) for z in (0, 1.5) for y in (-1, 1) for x in (-2, 2)], float)
QUADS = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6), (4, 5, 7, 6)]
CHARTS = [(0.05, 0.05), (0.55, 0.05), (0.05, 0.55), (0.55, 0.55), (0.30, 0.30)]


@pytest.fixture(autouse=True)
def nothing_left_behind():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    yield
    kept = {n: len(getattr(bpy.data, n)) for n in ("objects", "meshes", "materials", "images", "collections", "texts")}
    assert not any(kept.values()), kept
    assert len(bpy.data.scenes) == 1


def obj_text(points=CORNERS, chart=0.4, shift=0.0, with_uv=True, names=("car_paint", "window glass")) -> str:
    """A box: four painted sides, each with a chart of its own, and a roof of another material."""
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    for u, v in CHARTS:
        lines += [f"vt {u + a * chart + shift} {v + b * chart}" for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for i, quad in enumerate(QUADS):
        lines += [f"usemtl {names[i == 4]}"] if i in (0, 4) else []
        lines.append("f " + " ".join(f"{c + 1}/{4 * i + k + 1}" if with_uv else f"{c + 1}" for k, c in enumerate(quad)))
    return "\n".join(lines) + "\n"


@pytest.fixture
def box_obj(tmp_path) -> Path:
    path = tmp_path / "box.obj"
    path.write_text(obj_text())
    return path


def write_glb(path: Path, points=CORNERS, name="body paint") -> Path:
    """The box's sides as glTF (y up, front +z) with one material and no UVs."""
    faces = [triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))]
    look = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name=name))
    trimesh.Trimesh(points[:, [1, 2, 0]], faces, visual=look, process=False).export(path)
    return path


def saved(path: Path) -> Path:
    """The session as a file, and a fresh session."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return path


def _painted_box(name="car"):
    box = mesh_object(name, CORNERS, QUADS)
    box.data.materials.append(bpy.data.materials.new("car paint"))  # its own
    return box


def refused(match: str, *arguments) -> None:
    with pytest.raises(RaucaError, match=match) as caught:
        import_vehicle(*arguments)
    assert "\n" not in str(caught.value)


def test_obj_keeps_its_uvs_and_finds_paint_by_name(box_obj):
    vehicle = import_vehicle(box_obj)
    assert vehicle.size().tolist() == [4.0, 2.0, 1.5]
    assert vehicle.positions[:, 2].min() == 0
    assert [(m.name, m.kind) for m in vehicle.materials] == [("car_paint", "paint"), ("window glass", "glass")]
    assert vehicle.paint_faces().sum() == 8
    painted = vehicle.uvs[vehicle.paint_faces()]
    assert np.allclose([painted.min(), painted.max()], [0.05, 0.95], atol=1e-6)
    assert "material 'car_paint', by its name" in " ".join(vehicle.notes)
    face = vehicle.triangles[0]
    edges = vehicle.positions[face[1:]] - vehicle.positions[face[0]]
    assert np.dot(np.cross(*edges), vehicle.normals[0, 0]) > 0


def test_a_file_is_read_whatever_of_the_open_scene_is_hidden(box_obj):
    hidden = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(hidden)
    layer = bpy.context.view_layer.layer_collection.children["hidden"]
    bpy.context.view_layer.active_layer_collection = layer
    hidden.hide_render = True
    assert len(import_vehicle(box_obj).triangles) == 10
    assert bpy.context.view_layer.active_layer_collection == layer
    bpy.data.collections.remove(hidden)


def test_y_up_obj_along_z_is_turned(tmp_path):
    path = tmp_path / "car.obj"
    path.write_text(obj_text(np.stack([CORNERS[:, 1], CORNERS[:, 2], CORNERS[:, 0]], axis=1)))
    vehicle = import_vehicle(path)
    assert np.allclose(vehicle.size(), [4.0, 2.0, 1.5])
    assert "y taken as up" in vehicle.notes[0]
    assert "front is taken at -y" in vehicle.notes[1]
    original = CORNERS - [0, 0, 0]
    assert np.allclose(sorted(map(tuple, vehicle.positions.tolist())), sorted(map(tuple, original.tolist())), atol=1e-6)


def test_mask_decides_which_faces_are_paint(box_obj, tmp_path):
    mask = np.zeros((128, 128), np.uint8)
    mask[64:, :64] = 255  # the lower left quarter: the first chart, and half a corner of the roof's
    (tmp_path / "mask.png").write_bytes(png_bytes(np.repeat(mask[..., None], 3, axis=2)))
    vehicle = import_vehicle(box_obj, tmp_path / "mask.png", "car_paint")
    assert vehicle.paint_faces().tolist() == [True, True] + [False] * 8
    assert np.array_equal(vehicle.paint_mask, mask)
    assert [m.name for m in vehicle.materials] == ["car_paint", "car_paint (unpainted)", "window glass"]


def test_texture_beside_an_obj_is_read(box_obj, tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    (tmp_path / "box.png").write_bytes(png_bytes(pixels))
    vehicle = import_vehicle(box_obj, None, "car_paint")
    assert np.array_equal(vehicle.base_texture, pixels)
    assert vehicle.paint_mask.shape == (64, 64)
    assert vehicle.materials[0].textured


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"with_uv": False}, "they are missing"),
        ({"chart": 0.0, "shift": 0.0}, "cover no texel"),
        ({"chart": 0.9}, "beyond the texture|used twice"),
    ],
)
def test_unusable_uvs_are_unwrapped_and_told(tmp_path, changes, said):
    path = tmp_path / "box.obj"
    path.write_text(obj_text(**changes))
    vehicle = import_vehicle(path, None, "car_paint")
    note = next(n for n in vehicle.notes if n.startswith("UVs:"))
    assert re.search(said + r".*unwrapped anew", note)
    report = atlas_report(vehicle)
    assert (report.overlap, report.out_of_range) == (0.0, 0)
    assert report.utilisation > 0.4


def test_uvs_in_another_tile_are_wrapped(tmp_path, box_obj):
    (tmp_path / "far.obj").write_text(obj_text(shift=3.0))
    far, near = import_vehicle(tmp_path / "far.obj"), import_vehicle(box_obj)
    assert np.allclose(far.uvs[far.paint_faces()], near.uvs[near.paint_faces()], atol=1e-5)


def test_glb_is_read_z_up_with_its_front_ahead(tmp_path):
    vehicle = import_vehicle(write_glb(tmp_path / "car.glb"), None, "body paint")
    assert np.allclose(vehicle.size(), [4.0, 2.0, 1.5])
    assert any("unwrapped anew" in note for note in vehicle.notes)


def test_blend_with_a_script_is_read_and_never_run(tmp_path):
    mark = tmp_path / "ran"
    item = _painted_box()
    item.scale = (1, -1, 1)  # mirrored: faces must come out the right way round
    driver = item.driver_add("location", 2).driver
    driver.type, driver.expression = "SCRIPTED", f"__import__('pathlib').Path({str(mark)!r}).touch() or 0.0"
    bpy.data.libraries.write(str(tmp_path / "car.blend"), {item})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    vehicle = import_vehicle(tmp_path / "car.blend", None, "car paint")
    assert not mark.exists()
    assert np.allclose(vehicle.size(), [4.0, 2.0, 1.5])
    corners = vehicle.positions[vehicle.triangles].astype(float)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((corners.mean(axis=1) - [0, 0, 0.75]) * outward).sum(axis=1).min() > 0


@pytest.mark.parametrize("kept", ["object", "collection", "asset"])
def test_an_asset_is_read_though_it_lies_in_no_scene_of_its_file(tmp_path, kept):
    box = _painted_box()
    scene = bpy.data.scenes[0]
    scene.collection.objects.link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    if kept == "object":
        box.use_fake_user = True
    else:
        collection = bpy.data.collections.new("assets")
        collection.objects.link(box)
        collection.use_fake_user = kept == "collection"
        if kept == "asset":
            collection.asset_mark()
    assert len(import_vehicle(saved(tmp_path / "asset.blend"), None, "car paint").triangles) == 10


def test_a_vehicle_that_its_scene_hides_is_none_and_neither_is_what_lies_beside_the_scene(tmp_path):
    widget = _painted_box("widget")
    widget.use_fake_user = True
    hidden = bpy.data.collections.new("hidden")
    hidden.hide_render = True
    hidden.objects.link(_painted_box())
    bpy.data.scenes[0].collection.children.link(hidden)
    refused("has no faces that renders show", saved(tmp_path / "car.blend"), None, "car paint")


@pytest.mark.parametrize("of", ["world", "backdrop", "material", "group", "modifier", "instance"])
def test_only_images_that_the_vehicle_uses_are_measured(tmp_path, of):
    box, backdrop, world = _painted_box(), _painted_box("backdrop"), bpy.data.worlds.new("sky")
    backdrop.hide_render = True
    scene = bpy.data.scenes[0]
    scene.world = world
    for thing in (box, backdrop):
        scene.collection.objects.link(thing)
    if of == "instance":
        parts, shown = bpy.data.collections.new("parts"), bpy.data.objects.new("shown", None)
        scene.collection.objects.unlink(box)
        parts.objects.link(box)
        shown.instance_type, shown.instance_collection = "COLLECTION", parts
        scene.collection.objects.link(shown)
    header = png_bytes(np.zeros((4, 4), np.uint8)).replace(struct.pack(">II", 4, 4), struct.pack(">II", 16384, 8192))
    (tmp_path / "vast.png").write_bytes(header)
    image = bpy.data.images.new("vast", 4, 4)
    image.source, image.filepath = "FILE", str(tmp_path / "vast.png")
    if of == "modifier":
        texture = bpy.data.textures.new("vast", "IMAGE")
        texture.image = image
        box.modifiers.new("displace", "DISPLACE").texture = texture
    else:
        owner = {"world": world, "backdrop": backdrop.data.materials[0]}.get(of, box.data.materials[0])
        if owner.node_tree is None:
            owner.use_nodes = True  # until 5.0
        tree = owner.node_tree
        if of == "group":
            group = bpy.data.node_groups.new("group", "ShaderNodeTree")
            tree.nodes.new("ShaderNodeGroup").node_tree = group
            tree = group
        tree.nodes.new("ShaderNodeTexImage" if of != "world" else "ShaderNodeTexEnvironment").image = image
    path = saved(tmp_path / "car.blend")
    if of in ("world", "backdrop"):
        assert len(import_vehicle(path, None, "car paint").triangles) == 10
    else:
        refused("image 'vast': 16384x8192 pixels; at most 8192x8192 are read", path, None, "car paint")


def test_smart_project_serves_where_xatlas_is_missing(box_obj, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xatlas", None)
    box_obj.write_text(obj_text(with_uv=False))
    vehicle = import_vehicle(box_obj, None, "car_paint")
    assert any("own unwrapping" in note for note in vehicle.notes)
    assert atlas_report(vehicle).overlap == 0.0
    assert smart_project(vehicle).shape == (8, 3, 2)


def test_shipped_folder_is_read_as_it_is():
    folder = assets_folder() / "vehicles" / "sedan"
    vehicle = import_vehicle(folder)
    assert vehicle.name == "sedan"
    refused("brings its own paint", folder, None, "paint")


def test_the_real_car(shared_folder):
    folder = shared_folder / "vehicles" / "etron"
    if not folder.is_dir():
        pytest.skip("the shared car is not on this machine")
    vehicle = import_vehicle(folder / "etron.obj", folder / "paint_mask.png", None)
    assert len(vehicle.triangles) == 23_145
    assert vehicle.paint_faces().sum() == 3_104
    assert vehicle.size()[0] == pytest.approx(4.856, abs=1e-3)
    assert vehicle.base_texture is not None
    assert np.array_equal(vehicle.base_texture, read_image_blender(folder / "etron.png"))
    assert not any(note.startswith("UVs:") for note in vehicle.notes)
    assert atlas_report(vehicle).overlap < 0.02
    refused("cannot tell which faces are paint", folder / "etron.obj")


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".gltf", ".blend"])
@pytest.mark.parametrize("content", [bytes(range(256)) * 40, b""])
def test_garbage(tmp_path, suffix, content):
    (tmp_path / f"garbage{suffix}").write_bytes(content)
    refused("cannot be read|no faces", tmp_path / f"garbage{suffix}")


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("car.fbx", "x", "'.fbx' is not read; use .obj"),
        ("car.obj", None, "not found"),
        ("car.obj", "v 0 0 0\nv 1 0 0\n", "no faces"),
        ("car.obj", obj_text().replace("v 2.0 ", "v nan "), "vertices are NaN"),
        ("car.obj", obj_text(CORNERS * 100.0), "metres are expected; scale it"),
        ("car.obj", obj_text(CORNERS * 0.01), "metres are expected; scale it"),
        ("car.obj", obj_text(names=("a", "b")), "cannot tell which faces are paint"),
    ],
)
def test_bad_files(tmp_path, name, content, told):
    if content is not None:
        (tmp_path / name).write_text(content)
    refused(told, tmp_path / name)


def test_a_glb_of_no_numbers(tmp_path):
    broken = CORNERS.copy()
    broken[3] = np.nan
    refused("NaN", write_glb(tmp_path / "nan.glb", broken), None, "body paint")


def test_bad_paint(tmp_path, box_obj):
    refused("it has 'car_paint', 'window glass'", box_obj, None, "chrome")
    refused("not found", box_obj, tmp_path / "none.png")
    mask = tmp_path / "mask.png"
    mask.write_bytes(b"no image")
    refused("not a readable image", box_obj, mask, None)
    corner = np.zeros((64, 64))
    corner[0, 0] = 255
    for pixels, told in (
        (np.zeros((64, 64)), "is black"),
        (np.full((64, 128), 255), "must be square"),
        (np.full((32, 32), 255), "at least 64x64"),
        (np.full((64, 64, 3), (255, 0, 0)), "has colors"),
        (corner, "white nowhere on the vehicle's UVs"),
    ):
        mask.write_bytes(png_bytes(pixels.astype(np.uint8)))
        refused(told, box_obj, mask, None)
    mask.write_bytes(png_bytes(np.full((64, 64), 255, np.uint8)))
    (tmp_path / "bare.obj").write_text(obj_text(with_uv=False))
    refused("its UVs cannot be used", tmp_path / "bare.obj", mask, None)
    (tmp_path / "box.png").write_bytes(png_bytes(np.zeros((128, 128, 3), np.uint8)))
    refused("is 64x64, the texture 128x128", box_obj, mask, None)
