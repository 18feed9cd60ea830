"""The town: districts that differ, the same bits whichever way one comes, and room for the vehicle and the cameras."""

from dataclasses import dataclass, field

import bpy
import numpy as np
import pytest
from mathutils.bvhtree import BVHTree

from blender_addon.scene.blocks import values_of
from blender_addon.scene.massing import BOX_FACES
from blender_addon.scene.town import Town
from blender_addon.scene.town.sides import ROWS
from blender_addon.scene.town.site import layout
from blender_addon.scene.town.tables import DISTRICTS, FURNITURE, GLAZINGS, PARKED, SURFACES, TREES
from rauca_core.contract import Quality, Ring, Weather
from rauca_core.contract.color import linear_to_srgb
from rauca_core.contract.semantics import CLASS_IDS, CLASSES
from rauca_core.contract.viewpoints import eye_at

from .conftest import small_session

SEEDS, LOCATIONS = (1, 2), 6
BODY = (2.35, 0.95, 1.5)  # half length, half width, height of a car, metres
OTHER_CLASSES = {"truck", "bus", "motorcycle", "bicycle"}


@dataclass
class Findings:
    """What was measured in one district."""

    name: str
    occluded: list[bool] = field(default_factory=list)
    wheels: list[tuple[str, float]] = field(default_factory=list)  # class below each wheel, its height
    touched: list[str] = field(default_factory=list)
    parked: list[tuple[int, str, set[str]]] = field(default_factory=list)
    parked_in_walls: list[str] = field(default_factory=list)
    classes: set[str] = field(default_factory=set)
    lamps: int = 0


@pytest.fixture(scope="module")
def findings():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    found = []
    for seed in SEEDS:
        scene = bpy.data.scenes.new("town")
        town = Town(scene, seed)
        for location in range(LOCATIONS):
            town.enter(location)
            scene.view_layers[0].update()
            found.append(_inspect(scene, town, location))
    return found


def _inspect(scene, town, location):
    result = Findings(town.layout(location).district.name, lamps=len(town.lamps))
    pose, depsgraph = town.pose(location), scene.view_layers[0].depsgraph

    def look(start, end):
        ray = np.asarray(end) - start
        length = np.linalg.norm(ray)
        return scene.ray_cast(depsgraph, start.tolist(), (ray / length).tolist(), distance=float(length))

    def placed(points):
        return np.asarray(points, float) @ pose[:3, :3].T + pose[:3, 3]

    aims = placed([(x, y, z) for x in (-2.0, 2.0) for y in (-0.8, 0.8) for z in (0.4, 1.3)])
    for azimuth in range(0, 360, 45):
        for elevation, distance in ((2, 5), (2, 8), (2, 11.5), (15, 8), (15, 11.5), (40, 6), (40, 11.5)):
            eye = placed(eye_at(azimuth + 10, elevation, distance, np.array([0.0, 0.0, 0.7])))
            result.occluded.append(np.mean([look(eye, aim)[0] for aim in aims]) > 0.5)
    for wheel in placed([(x, y, 0.5) for x in (-1.4, 1.4) for y in (-0.75, 0.75)]):
        hit, where, _, face, thing, _ = look(wheel, wheel - [0, 0, 2.0])
        assert hit
        material = thing.data.materials[thing.data.polygons[face].material_index]
        result.wheels.append((material["rauca_class"], where[2] - pose[2, 3]))
    car = _box_tree(placed(_corners((-BODY[0], -BODY[1], 0.05), BODY)))
    meshes = [o for o in scene.objects if o.type == "MESH"]
    trees = {o.name: _tree_of(o) for o in meshes}
    result.touched = [name for name, tree in trees.items() if car.overlap(tree)]
    for thing in (o for o in meshes if "rauca_instance" in o):
        used = {m["rauca_class"] for m in thing.data.materials}
        result.parked.append((thing["rauca_instance"], thing["rauca_category"], used))
        low, high = (np.array(thing.bound_box)[i] for i in (0, 6))
        corners = _corners((*low[:2], 0.2), high) @ np.array(thing.matrix_world)[:3, :3].T
        hull = _box_tree(corners + np.array(thing.matrix_world)[:3, 3])
        others = [n for n in trees if n != thing.name and not n.startswith("rauca tree")]
        result.parked_in_walls += [f"{thing.name}: {n}" for n in others if hull.overlap(trees[n])]
    result.classes = {m["rauca_class"] for o in meshes for m in o.data.materials}
    return result


def _corners(low, high):
    return np.array([(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])


def _box_tree(corners):
    return BVHTree.FromPolygons(corners.tolist(), BOX_FACES)


def _tree_of(thing):
    frame = np.array(thing.matrix_world)
    placed = values_of(thing.data.vertices, "co", np.float32, 3) @ frame[:3, :3].T + frame[:3, 3]
    return BVHTree.FromPolygons(placed.tolist(), [tuple(p.vertices) for p in thing.data.polygons])


def test_districts_take_turns_in_an_order_of_the_seed():
    for seed in range(5):
        assert len({layout(seed, i).district.name for i in range(LOCATIONS)}) == LOCATIONS
        assert layout(seed, 0).district is layout(seed, LOCATIONS).district
        assert not np.allclose(layout(seed, 0).pose, layout(seed, LOCATIONS).pose)
    assert len({layout(seed, 0).district.name for seed in range(12)}) > 2
    shapes = {(bool(p.path.curvature), p.crossing_m is not None) for p in (layout(s, 1) for s in range(12))}
    assert len(shapes) == 3  # straight, bend, crossing


def test_tables_name_what_there_is():
    materials = {*SURFACES, *GLAZINGS}
    for district in DISTRICTS:
        assert {district.road, district.pavement, district.apron, *district.walls} <= materials, district.name
        assert set(district.furniture) <= set(FURNITURE), district.name
        assert set(district.trees) <= set(TREES), district.name
        assert set(district.sides) <= set(ROWS), district.name
    for name, thing in {**FURNITURE, **PARKED}.items():
        used = {material for _, material, *_ in thing.solids} | {one for some in thing.colors.values() for one in some}
        assert used <= materials | set(thing.colors), name
    assert {leaf for tree in TREES.values() for leaf in tree.leaves} <= materials


def test_most_views_see_the_vehicle(findings):
    assert np.mean([np.mean(f.occluded) for f in findings]) < 0.10
    assert max(np.mean(f.occluded) for f in findings) < 0.35


def test_the_vehicle_stands_on_the_road(findings):
    for found in findings:
        assert {name for name, _ in found.wheels} <= {"road", "marking"}, found.name
        assert max(abs(height) for _, height in found.wheels) < 0.01, found.name


def test_nothing_stands_in_the_vehicle_nor_in_the_parked_ones(findings):
    for found in findings:
        assert found.touched == [], found.name
        assert found.parked_in_walls == [], found.name


def test_parked_vehicles_are_of_other_classes_and_told_apart(findings):
    parked = [vehicle for found in findings for vehicle in found.parked]
    assert {category for _, category, _ in parked} == OTHER_CLASSES
    assert {name for _, _, used in parked for name in used} == {"other_vehicle"}
    for found in findings:
        assert sorted(number for number, _, _ in found.parked) == list(range(1, len(found.parked) + 1))


def test_every_material_names_a_known_class_and_each_district_has_lamps(findings):
    assert {name for found in findings for name in found.classes} <= set(CLASSES)
    for found in findings:
        assert {"road", "building", "window", "vegetation", "pole"} <= found.classes | {"vegetation"}, found.name
        assert found.lamps >= 2


@pytest.fixture
def town_session(box_vehicle):
    quick = {"size": 64, "quality": Quality(2, denoise=False), "light": False, "locations": 4}
    return lambda: small_session(box_vehicle, **quick, ring=Ring((40.0, 220.0), (12.0,), (8.0,)))


@pytest.mark.parametrize("weather", [Weather("day", 45.0), Weather("night", -30.0)], ids=lambda w: w.name)
def test_a_frame_is_the_same_bits_whichever_way_one_came(town_session, weather):
    def frames(order):
        session, seen = town_session(), {}
        for location in order:
            session.enter(location)
            session.annotations(location, [0])
            session.set_weather(weather)
            seen[location] = session.render(location, 0, weather)
        return seen

    straight, roundabout = frames((0, 1)), frames((1, 0, 1, 0))
    for location, image in straight.items():
        assert np.array_equal(image, roundabout[location]), location


def test_locations_look_different_and_show_different_things(town_session):
    session, images, contents = town_session(), [], []
    weather = session.plan.weathers[0]
    for location in range(4):
        session.enter(location)
        seen = session.annotations(location, [0, 1])
        counts = [np.bincount(seen[view].semantic.ravel(), minlength=len(CLASSES)) for view in (0, 1)]
        contents += [count / count.sum() for count in counts]
        session.set_weather(weather)
        images += [linear_to_srgb(session.render(location, view, weather)) for view in (0, 1)]
    for i in range(len(images)):
        for j in range(i):
            assert np.abs(images[i] - images[j]).mean() > 0.05, (i, j)
    spread = np.ptp(contents, axis=0)
    shown = {CLASSES[k] for k in np.flatnonzero(np.max(contents, axis=0) > 0.003)}
    assert spread.max() > 0.15
    assert {"road", "sky", "building", "window", "paint"} <= shown


def test_windows_shine_at_night_only(town_session):
    session = town_session()
    session.enter(0)
    ids = session.annotations(0, [0, 1])
    brightest = {}
    for lit in (0.0, 1.0):
        session.set_weather(Weather("night", -30.0))
        session.place.light_windows(lit)
        views = [
            session.render(0, view, Weather("night", -30.0))[ids[view].semantic == CLASS_IDS["window"]]
            for view in (0, 1)
        ]
        brightest[lit] = np.concatenate(views).max()
    assert brightest[1.0] > 2 * brightest[0.0]


@pytest.mark.parametrize("own", ["truck", "bus"])
def test_none_of_the_vehicles_own_class_is_parked(own):
    """Average precision counts one object of the class in an image."""

    def parked(own_class):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        town = Town(bpy.data.scenes.new("town"), SEEDS[0], own_class)
        found = set()
        for location in range(LOCATIONS):
            town.enter(location)
            found |= {(location, o["rauca_category"]) for o in bpy.data.objects if "rauca_category" in o}
        return found

    every = parked("car")
    assert parked(own) == {one for one in every if one[1] != own} != every
