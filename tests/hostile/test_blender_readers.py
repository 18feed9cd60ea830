"""Vehicle files and images inside Blender: what Blender would follow, fill or run is refused before it is asked."""

from __future__ import annotations

import json
import struct

import pytest

from rauca_core.contract import RaucaError

bpy = pytest.importorskip("bpy", reason="the bpy wheel is not installed")

from blender_addon.scene.vehicle_files import import_vehicle  # noqa: E402

from .blender_targets import MTL, TARGETS  # noqa: E402
from .nasty import jpeg, png  # noqa: E402
from .readers import READERS as OUTSIDE  # noqa: E402
from .test_readers import CORPUS, for_damaged, kept  # noqa: E402

READERS = {target.name: target for target in TARGETS if target.name != "blend"}  # Blender's own reader may crash


@pytest.fixture(autouse=True)
def nothing_left_behind():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    yield
    assert not [*bpy.data.objects, *bpy.data.meshes, *bpy.data.images, *bpy.data.materials]


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_refused(name, tmp_path):
    target = READERS[name]

    def read(data: bytes) -> None:
        complaint = target.try_on(tmp_path, data)
        assert complaint is None or "\n" not in str(complaint)

    for_damaged(target, target.seed(tmp_path), 8, read)


@pytest.mark.parametrize("path", kept(READERS), ids=lambda path: f"{path.parent.name}-{path.name[:12]}")
def test_what_fuzzing_found(path, tmp_path):
    target = READERS[path.parent.name]
    target.seed(tmp_path)
    complaint = target.try_on(tmp_path, path.read_bytes())
    assert complaint is None or "\n" not in str(complaint)


def test_everything_that_fuzzing_found_is_some_readers():
    assert {folder.name for folder in CORPUS.iterdir()} <= {*OUTSIDE, *READERS}


def _gltf(folder, **changes):
    """The healthy .gltf with other fields."""
    document = json.loads(READERS["gltf"].seed(folder))
    for name, value in changes.items():
        document[name] = value(document[name]) if callable(value) else value
    return json.dumps(document).encode()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"buffers": lambda b: [{**b[0], "uri": "../secret.bin"}]}, "outside its folder"),
        ({"buffers": lambda b: [{**b[0], "uri": "%2e%2e/secret.bin"}]}, "outside its folder"),
        ({"buffers": lambda b: [{**b[0], "uri": "/etc/hostname"}]}, "outside its folder"),
        ({"buffers": lambda b: [{**b[0], "uri": "link.bin"}]}, "outside its folder"),
        ({"images": [{"uri": "../secret.png"}]}, "outside its folder"),
        ({"images": [{"uri": "vast.png"}]}, "at most 8192x8192"),
        ({"nodes": [{"children": [0]}]}, "no tree"),
        ({"nodes": [{"children": [i + 1, i + 1]} for i in range(60)] + [{"mesh": 0}]}, "no tree"),
        ({"nodes": [{}] * 100_001}, "nodes; at most"),
        ({"accessors": lambda a: [*a, {"count": 2**40, "type": "VEC3", "componentType": 5126}]}, "more zeros"),
        ({"accessors": lambda a: [{**a[0], "count": 2**70}, *a[1:]]}, "cannot be read"),
        ({"bufferViews": lambda v: [{**v[0], "byteOffset": -(2**40)}, *v[1:]]}, "cannot be read"),
    ],
)
def test_a_gltf_keeps_to_its_folder_and_its_size(changes, words, tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    data = _gltf(folder, **changes)
    (tmp_path / "secret.bin").write_bytes((folder / "box.bin").read_bytes())
    (tmp_path / "secret.png").write_bytes(png(4, 4))
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "vast.png").write_bytes(png(60_000, 60_000))
    complaint = READERS["gltf"].try_on(folder, data)
    assert complaint is not None, "was read"
    assert words in str(complaint)


@pytest.mark.parametrize(
    ("mtl", "obj", "words"),
    [
        (MTL.replace("skin.png", "../secret.png"), "box.mtl", "outside its folder"),
        (MTL.replace("skin.png", "vast.png"), "box.mtl", "at most 8192x8192"),
        (MTL, "../secret.mtl", "outside its folder"),
        (MTL.replace("skin.png", "../gone.png"), "../gone.mtl box.mtl", None),  # of the machine it was exported on
    ],
)
def test_an_obj_keeps_to_its_folder(mtl, obj, words, tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    healthy = READERS["obj"].seed(folder)
    (tmp_path / "secret.mtl").write_text(MTL)
    (tmp_path / "secret.png").write_bytes(png(4, 4))
    (folder / "vast.png").write_bytes(png(60_000, 60_000))
    (folder / "box.mtl").write_text(mtl)
    complaint = READERS["obj"].try_on(folder, healthy.replace(b"mtllib box.mtl", b"mtllib " + obj.encode()))
    assert (complaint is None) == (words is None)
    assert words is None or words in str(complaint)


@pytest.mark.parametrize(("name", "data"), [("png", png(60_000, 60_000)), ("jpeg", jpeg(65_500, 65_500))])
def test_an_image_is_measured_before_it_is_decoded(name, data, tmp_path):
    target = READERS[f"blender-{name}"]
    target.seed(tmp_path)
    assert "at most 8192x8192" in str(target.try_on(tmp_path, data))


def test_a_picture_that_unpacks_to_more_than_it_says_is_no_thumbnail(tmp_path):
    target = READERS["thumbnail"]
    target.seed(tmp_path)
    bomb = png(4, 4).replace(struct.pack(">II", 4, 4), struct.pack(">II", 1, 1))
    assert target.try_on(tmp_path, bomb) is None


def test_a_driver_of_a_vehicle_is_never_run(tmp_path):
    trace, path = tmp_path / "driver was run", tmp_path / "box.blend"
    mesh = bpy.data.meshes.new("car body")
    mesh.from_pydata([(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 1.5)], [], [(0, 1, 2), (0, 2, 3)])
    mesh.materials.append(bpy.data.materials.new("car_paint"))
    body = bpy.data.objects.new("car", mesh)
    body.driver_add("location", 0).driver.expression = f"open({str(trace)!r}, 'w').write('x') or 7.0"
    bpy.data.libraries.write(str(path), {body}, fake_user=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    trace.unlink(missing_ok=True)
    preferences = bpy.context.preferences.filepaths
    before = preferences.use_scripts_auto_execute
    preferences.use_scripts_auto_execute = True  # however much the user trusts others
    try:
        import_vehicle(path, paint_material="car_paint")
    except RaucaError:
        pass  # of such a body; what matters is that its scene was evaluated
    finally:
        preferences.use_scripts_auto_execute = before
    assert not trace.exists()
