"""A .blend of the user's own: its marks become locations, its scripts stay off, its faults are told in one line."""

import math
from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.scene.session import Session, build_place
from blender_addon.scene.user_scene import UserScene
from rauca_core.contract import Quality, RaucaError, Ring, Scenery, Weather
from rauca_core.contract.semantics import CLASS_IDS

from .conftest import mesh_object, small_plan


@pytest.fixture
def yard(tmp_path):
    """Writes a .blend: a floor, a lamp, a sun, a world, marks, and a driver that would leave a trace."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    trace = tmp_path / "driver was run"

    def write(marks=("rauca b", "rauca a"), change=None, name="yard.blend"):
        scene = bpy.data.scenes.new("yard")
        floor = _quad("floor", 30.0, 0.5, "slab")
        floor.data.materials[0]["rauca_class"] = "road"
        inner = bpy.data.collections.new("things")
        scene.collection.children.link(inner)
        inner.objects.link(floor)
        block = _quad("block", 1.0, 3.0, "stone")
        driver = block.driver_add("location", 0).driver
        driver.expression = f"open({str(trace)!r}, 'w').write('x') or 7.0"
        block.location = (0.0, 15.0, 0.0)
        inner.objects.link(block)
        for kind, title in (("SUN", "sun"), ("SPOT", "rauca lamp 1"), ("POINT", "shop light")):
            scene.collection.objects.link(bpy.data.objects.new(title, bpy.data.lights.new(title, kind)))
        for i, title in enumerate(marks):
            mark = bpy.data.objects.new(title, None)
            mark.location = (3.0 * i, -2.0, 0.5)
            mark.rotation_euler, mark.scale = (0.1, 0.0, math.radians(90 * i)), (2, 3, 4)
            scene.collection.objects.link(mark)
        scene.world = bpy.data.worlds.new("dusk")
        if change is not None:
            change(scene)
        path = tmp_path / name
        bpy.data.libraries.write(str(path), {scene}, fake_user=True)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        trace.unlink(missing_ok=True)
        return path

    write.trace = trace
    return write


def _quad(name, half, height, *materials):
    corners = [(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)]
    return mesh_object(name, corners, [(0, 1, 2, 3)], *materials)


def _plan(vehicle, path, locations=2):
    quick = {"size": 48, "quality": Quality(2, denoise=False), "light": False, "ring": Ring((30.0,), (25.0,), (7.0,))}
    return small_plan(vehicle.atlas_id, **quick, locations=locations, scenery=Scenery.of_file(path))


def _place(path, locations=2, own="car"):
    scene = bpy.data.scenes.new("rauca")
    return scene, UserScene(scene, path, locations, own)


@pytest.fixture
def entered(yard, box_vehicle):
    """Writes a changed .blend and enters its first location."""

    def enter(change=None, **plan):
        path = yard(change=change)
        session = Session(replace(_plan(box_vehicle, path), **plan), box_vehicle, path)
        session.enter(0)
        return session

    return enter


def _instance(scene, collection, x=3.0, y=-5.5, number=None, category="bus"):
    """An empty that shows a collection, beside the first location's vehicle."""
    shown = bpy.data.objects.new("shown", None)
    shown.instance_type, shown.instance_collection, shown.location = "COLLECTION", collection, (x, y, 0.5)
    if number:
        shown["rauca_instance"], shown["rauca_category"] = number, category
    scene.collection.objects.link(shown)
    return shown


def test_marks_are_locations_in_order_of_their_names(yard):
    path = yard()
    scene, place = _place(path)
    for location, (x, turn) in enumerate(((3.0, 90.0), (0.0, 0.0))):  # "rauca a" was the second one written
        pose = place.pose(location)
        assert pose[:3, 3] == pytest.approx((x, -2.0, 0.5), abs=1e-6)
        assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-6)
        assert pose[2, :3] == pytest.approx((0, 0, 1))
        assert math.degrees(math.atan2(pose[1, 0], pose[0, 0])) == pytest.approx(turn, abs=1e-4)
    assert [lamp.name for lamp in place.lamps] == ["rauca lamp 1"]
    names = {thing.name for thing in scene.objects}
    assert {"floor", "block", "shop light", "rauca lamp 1"} <= names
    assert "sun" not in names
    assert scene.world is None
    assert [s.name for s in bpy.data.scenes if s.name == "yard"] == []
    told = " ".join(place.notes)
    assert "sun 'sun'" in told
    assert "world 'dusk'" in told
    assert "1 materials name no rauca_class" in told
    assert all("\n" not in note for note in place.notes)


def test_no_script_of_the_file_is_run(yard):
    path = yard()
    before = bpy.context.preferences.filepaths.use_scripts_auto_execute
    bpy.context.preferences.filepaths.use_scripts_auto_execute = True  # however much the user trusts others
    try:
        scene, _ = _place(path)
        scene.frame_set(5)
        scene.view_layers[0].update()
    finally:
        bpy.context.preferences.filepaths.use_scripts_auto_execute = before
    assert not yard.trace.exists()
    assert scene.objects["block"].animation_data is None or not scene.objects["block"].animation_data.drivers


def test_a_frame_of_the_users_scene(entered):
    session = entered()
    for location in (0, 1):
        session.enter(location)
        seen = session.annotations(location, [0])[0]
        assert seen.visible > 0.95
        shown = set(np.unique(seen.semantic).tolist())
        assert CLASS_IDS["road"] in shown  # the floor's own class
        session.set_weather(session.plan.weathers[0])
        assert np.isfinite(session.render(location, 0, session.plan.weathers[0])).all()


@pytest.mark.parametrize("falloff", [0.0, 2.0])
def test_fog_lies_on_the_ground_wherever_the_vehicle_stands(entered, falloff):
    fog = Weather("fog", 45.0, fog_density=90.0, fog_falloff=falloff)

    def picture(x, z):
        def move(scene):
            for thing in scene.objects:
                thing.location.x, thing.location.z = thing.location.x + x, thing.location.z + z

        session = entered(move, quality=Quality(16, denoise=False), weathers=(fog,))
        session.set_weather(fog)
        return session.render(0, 0, fog)

    here, there = picture(0.0, 0.0), picture(400.0, 20.0)
    assert np.abs(there - here).mean() < 0.01 * here.mean()


def test_another_file_than_the_plans_is_refused(yard, box_vehicle):
    plan = _plan(box_vehicle, yard())
    other = yard(marks=("rauca a",), name="other.blend")
    scene = bpy.data.scenes.new("rauca")
    with pytest.raises(RaucaError, match="not the scene"):
        build_place(scene, plan, other)
    with pytest.raises(RaucaError, match="give that file as --scene"):
        build_place(scene, replace(plan), None)


def refused(path, words, *more):
    """Another scene is told in one line that names it, and nothing of it is left behind."""
    before = [sorted(kind.keys()) for kind in (bpy.data.objects, bpy.data.materials)]
    with pytest.raises(RaucaError, match=words) as told:
        _place(path, *more)
    assert str(path) in str(told.value)
    assert "\n" not in str(told.value)
    assert [sorted(kind.keys()) for kind in (bpy.data.objects, bpy.data.materials)] == before


@pytest.mark.parametrize(
    ("marks", "locations", "words"),
    [
        ((), 1, "marks no location"),
        (("place 1",), 1, "marks no location"),
        (("rauca a", "rauca b"), 3, "marks 2 locations .rauca a, rauca b. but 3 are asked for"),
    ],
)
def test_missing_marks(yard, marks, locations, words):
    refused(yard(marks), words, locations)


def misname(scene):
    scene.objects["block"].data.materials[0]["rauca_class"] = "wall"


def lose_image(scene):
    image = bpy.data.images.new("bricks", 4, 4)
    image.source, image.filepath = "FILE", "//lost.png"
    material = scene.objects["block"].data.materials[0]
    if material.node_tree is None:
        material.use_nodes = True  # until 5.0
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image


def upend(scene):
    scene.objects["rauca a"].rotation_euler = (0.0, math.radians(-90), 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [(misname, "rauca_class 'wall'"), (lose_image, "lost.png is missing"), (upend, "no direction")],
)
def test_faults_of_the_scene_are_told(yard, change, words):
    refused(yard(change=change), words)


@pytest.mark.parametrize(
    ("number", "category"),
    [*((number, "bus") for number in (255, 0, "7", 7.4, math.nan, math.inf, True)), (7, "boat"), (7, 3), (7, None)],
)
def test_an_object_that_is_no_other_vehicle_is_refused_before_anything_is_rendered(yard, number, category):
    def misnumber(scene):
        scene.objects["floor"]["rauca_instance"] = number
        if category is not None:
            scene.objects["floor"]["rauca_category"] = category

    words = r"object floor: rauca_instance .* a whole number from 1 to 254"
    refused(yard(change=misnumber), words, 2, "boat")


def _add_nodes(thing, kind, **settings):
    """A geometry nodes modifier of one node; ``settings`` are the values of its sockets."""
    group = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    begin, node, end = (group.nodes.new(name) for name in ("NodeGroupInput", kind, "NodeGroupOutput"))
    if "Geometry" in node.inputs:
        group.links.new(begin.outputs[0], node.inputs["Geometry"])
    if "Material" in node.inputs:
        node.inputs["Material"].default_value = bpy.data.materials["slab"]
    for name, value in settings.items():
        node.inputs[name].default_value = value
    group.links.new(node.outputs[0], end.inputs[0])
    modifier = thing.modifiers.new("nodes", "NODES")
    modifier.node_group = group
    return modifier


def test_what_is_linked_from_another_file_is_annotated_too(yard, tmp_path):
    library = tmp_path / "library.blend"

    def link(scene):
        props = bpy.data.collections.new("props")
        shed, lone = _quad("shed", 1.0, 2.0, "slab"), _quad("lone", 1.0, 1.0, "slab")
        props.objects.link(shed)
        bpy.data.libraries.write(str(library), {props, lone}, fake_user=True)
        for thing in (shed, lone, props):
            bpy.data.batch_remove([thing])
        with bpy.data.libraries.load(str(library), link=True) as (_, target):
            target.collections, target.objects = ["props"], ["lone"]
        for number in (1, 2):
            _instance(scene, target.collections[0], number=number)
        scene.collection.objects.link(target.objects[0])

    scene, _ = _place(yard(change=link))
    shown = {instance.object.original.name for instance in scene.view_layers[0].depsgraph.object_instances}
    assert {"shed", "lone", "floor", "block"} <= shown
    assert not any(thing.library or thing.data.library for thing in bpy.data.objects if thing.type == "MESH")


@pytest.mark.parametrize("kind", ["GeometryNodeSetMaterial", "GeometryNodeMeshCube"])
@pytest.mark.parametrize("hidden", ["nothing", "object", "modifier"])  # in the viewport alone
def test_a_surface_whose_material_geometry_nodes_choose_is_refused(yard, kind, hidden):
    def add_nodes(scene):
        modifier = _add_nodes(scene.objects["block"], kind)
        scene.objects["block"].hide_viewport = hidden == "object"
        modifier.show_viewport = hidden != "modifier"

    refused(yard(change=add_nodes), r"yard.blend: object block: its geometry nodes .* apply its modifiers")


def test_geometry_nodes_that_leave_the_materials_alone_are_welcome(yard):
    scene, _ = _place(yard(change=lambda scene: _add_nodes(scene.objects["floor"], "GeometryNodeTransform")))
    assert [slot.material.name for slot in scene.objects["floor"].material_slots] == ["slab"]


@pytest.mark.parametrize("how", ["object", "collection", "excluded", "instancer", "inner", "modifier", "nowhere"])
def test_what_no_render_shows_is_not_refused(entered, how):
    """Neither another vehicle of the data set's own class nor a material that geometry nodes choose."""

    def hide(scene):
        tools = bpy.data.collections.new("tools")
        tool = _quad("tool", 1.0, 1.0, "stone")
        tool.location = (3.0, -5.5, 0.5)
        tools.objects.link(tool)
        settings = {"Selection": False} if how == "nowhere" else {}
        modifier = _add_nodes(tool, "GeometryNodeSetMaterial", **settings)
        if how in ("modifier", "nowhere"):
            modifier.show_render = how == "nowhere"
        else:
            tool["rauca_instance"], tool["rauca_category"] = 3, "car"
        if how in ("instancer", "inner"):
            _instance(scene, tools, 0.0, 0.0).hide_render = how == "instancer"
        else:
            scene.collection.children.link(tools)
        tool.hide_render = how in ("object", "inner")
        tools.hide_render = how == "collection"
        if how == "excluded":
            layer = scene.view_layers[0]
            layer.update()  # of a new scene Blender 5.3 has no collections before
            layer.layer_collection.children["tools"].exclude = True

    assert entered(hide).annotations(0, [0])[0].others == ()


def test_a_collections_instance_has_its_own_number_before_what_it_brings(entered):
    """Numbers are whole, though a custom property is a float where nobody says otherwise."""

    def add_instance(scene):
        parts = bpy.data.collections.new("parts")
        inner = _quad("inner", 1.0, 1.0)
        inner["rauca_instance"], inner["rauca_category"] = 3, "car"
        parts.objects.link(inner)
        _instance(scene, parts, number=4.0)

    seen = entered(add_instance).annotations(0, [0])[0]
    assert [(other.id, other.category) for other in seen.others] == [(4, "bus")]


def test_what_a_collections_instance_brings_is_seen(entered):
    """Its sun stays behind; its truck is another vehicle where the instance says so, and only there."""

    def add_instances(scene):
        rig = bpy.data.collections.new("rig")
        rig.objects.link(bpy.data.objects.new("rig sun", bpy.data.lights.new("rig sun", "SUN")))
        truck = _quad("truck", 1.0, 1.0, "tarpaulin")
        truck.data.materials[0]["rauca_class"] = "pole"  # a class that nothing else here has
        rig.objects.link(truck)
        _instance(scene, rig, y=-5.5, number=9, category="truck")
        _instance(scene, rig, y=1.5)

    session = entered(add_instances)
    assert "sun 'rig sun'" in " ".join(session.place.notes)
    assert "rig sun" not in bpy.data.objects
    seen = session.annotations(0, [0])[0]
    assert [(other.id, other.category) for other in seen.others] == [(9, "truck")]
    assert (seen.semantic[seen.instances == 9] == CLASS_IDS["other_vehicle"]).all()
    elsewhere = seen.semantic[seen.instances != 9]
    assert (elsewhere == CLASS_IDS["pole"]).any()
    assert not (elsewhere == CLASS_IDS["other_vehicle"]).any()


@pytest.mark.parametrize("content", [b"not a scene", b"", b"BLENDER-v405"])
def test_what_is_no_blend_is_told(tmp_path, content):
    (tmp_path / "broken.blend").write_bytes(content)
    refused(tmp_path / "broken.blend", r"broken.blend: cannot be read as .blend", 1)
