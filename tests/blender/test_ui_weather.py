"""Step 2: weathers in the artist's own scene come, change and go without a trace."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.in_blender import save_weathers
from blender_addon.scene import render
from blender_addon.scene.blocks import all_blocks
from blender_addon.scene.shown_weather import rain_picture
from blender_addon.scene.town import Town
from blender_addon.scene.weather import SceneWeather
from blender_addon.steps.weather import gallery
from blender_addon.steps.weather.panel import state
from rauca_core.contract import Quality, Weather, find_preset, rain
from rauca_core.contract.assets import assets_folder
from tests.blender.conftest import refusal
from tools.thumbnails import shipped_weathers

FOG = Weather("mist", 30.0, 20.0, fog_density=50.0, cloudiness=40.0, wetness=30.0)


@pytest.fixture
def empty_scene() -> bool:
    return False


@pytest.fixture
def weather(addon):
    return addon.context.scene.rauca.weather


def blocks() -> set[str]:
    """Every data block by kind and name; what the session itself keeps (images, screens) does not change."""
    return {f"{type(block).__name__} {block.name_full}" for block in all_blocks()}


def settings_of(scene) -> dict[str, object]:
    owners = {"cycles": scene.cycles, "view": scene.view_settings, "eevee": scene.eevee, "render": scene.render}
    return {
        f"{label}.{p.identifier}": getattr(owner, p.identifier)
        for label, owner in owners.items()
        for p in owner.bl_rna.properties
        if p.type in {"FLOAT", "INT", "BOOLEAN", "ENUM", "STRING"} and not getattr(p, "is_array", False)
    }


def test_every_shipped_list_is_on_offer_and_every_weather_has_a_picture(addon):
    names = {path.stem for path in (assets_folder() / "weathers").glob("*.json")}
    assert {name for name, *_ in gallery.SHIPPED} == names
    for name in names:
        for weather in gallery.shipped(name):
            assert (assets_folder() / "weathers" / "pictures" / f"{weather.name}.jpg").is_file(), weather.name


def test_one_name_means_one_weather_in_every_list():
    assert len(shipped_weathers()) > 50


def test_showing_and_removing_leaves_the_scene_as_it_was(addon, weather):
    scene = addon.context.scene
    scene.view_settings.exposure = 0.5
    before, settings, world = blocks(), settings_of(scene), scene.world
    assert addon.ops.rauca.show_weather() == {"FINISHED"}
    assert scene.world != world
    assert scene.view_settings.view_transform == "Standard"
    weather.fog = 60.0
    assert addon.ops.rauca.remove_weather() == {"FINISHED"}
    assert blocks() == before
    assert settings_of(scene) == settings
    assert scene.world == world


def test_removing_keeps_what_the_artist_changed_meanwhile(addon, weather):
    scene = addon.context.scene
    addon.ops.rauca.show_weather()
    scene.view_settings.gamma = 1.4
    own = scene.world = addon.data.worlds.new("mine")
    addon.ops.rauca.remove_weather()
    assert scene.view_settings.gamma == pytest.approx(1.4)
    assert scene.world == own


def test_a_scene_without_a_world_has_none_again(addon):
    scene = addon.context.scene
    scene.world = None
    addon.ops.rauca.show_weather()
    addon.ops.rauca.remove_weather()
    assert scene.world is None


def test_sliders_move_the_shown_weather_and_nothing_else_does(addon, weather):
    scene, world = addon.context.scene, addon.context.scene.world
    weather.fog = 50.0
    assert scene.world == world  # nothing is shown yet
    addon.ops.rauca.show_weather()
    box = weather.shown.fog
    density = box.data.materials[0].node_tree.nodes["fog"].inputs["Density"]
    assert density.default_value == pytest.approx(0.015)
    assert not box.hide_viewport
    weather.fog = 0.0
    assert box.hide_viewport
    exposure = scene.cycles.film_exposure
    weather.sun_altitude = math.radians(5)
    assert scene.cycles.film_exposure > 3 * exposure


def test_the_shown_fog_lies_under_the_vehicle(addon, weather):
    addon.ops.rauca.show_weather()
    assert tuple(weather.shown.fog.location) == (0.0, 0.0, 0.0)  # no vehicle is picked
    addon.context.scene.cursor.location = (5.0, -3.0, 20.0)
    addon.ops.rauca.add_vehicle(vehicle="cube")
    addon.context.view_layer.update()
    addon.ops.rauca.show_weather()
    assert tuple(weather.shown.fog.location) == pytest.approx((5.0, -3.0, 20.0))


def test_a_deleted_part_comes_back_with_the_next_change(addon, weather):
    addon.ops.rauca.show_weather()
    addon.data.objects.remove(weather.shown.fog)
    weather.clouds = 30.0
    assert weather.shown.fog.name in addon.context.scene.objects


def test_cycles_sees_what_the_dataset_sees(addon, weather):
    """The same plane under the same weather, in the job's own scene and in the artist's."""

    def picture(scene):
        scene.collection.objects.link(plane)
        scene.camera = camera
        pixels = render.render_linear(scene, Quality(32, denoise=False), 7)
        scene.collection.objects.unlink(plane)
        return pixels[..., :3]

    addon.ops.mesh.primitive_plane_add(size=40.0)
    plane = addon.context.object
    camera = addon.data.objects["Camera"]
    addon.data.objects.remove(addon.data.objects["Cube"])
    addon.data.objects.remove(addon.data.objects["Light"])
    artists, own = addon.context.scene, addon.data.scenes.new("job")
    plane.users_collection[0].objects.unlink(plane)
    for scene in (own, artists):
        render.prepare(scene)
        scene.render.resolution_x = scene.render.resolution_y = 24
        scene.render.resolution_percentage = 100
    SceneWeather(own, []).apply(FOG)
    weather.pick(FOG)
    addon.ops.rauca.show_weather()
    first, second = picture(own), picture(artists)
    assert first.mean() > 0.05
    # EEVEE's lamp takes a place among the lights without giving any: other noise, the same light.
    assert np.abs(first.mean(axis=(0, 1)) / second.mean(axis=(0, 1)) - 1).max() < 0.02


def test_next_goes_round_the_list(addon, weather):
    weather.preset = "demo"
    names = [listed.name for listed in find_preset("demo")]
    seen = []
    for _ in range(len(names) + 1):
        seen.append(weather.picked)
        assert addon.ops.rauca.next_weather() == {"FINISHED"}
    assert seen == [*names, names[0]]
    addon.ops.rauca.next_weather(step=-1)
    assert weather.picked == names[0]


@pytest.mark.parametrize("name", ["demo", "base", "enhanced", "unseen", "carla", "single"])
def test_a_picked_weather_is_the_lists_own_to_the_last_digit(weather, name):
    for listed in find_preset(name):
        weather.preset = name
        weather.pick(listed)
        assert weather.current() == listed


def test_the_gallery_picks_by_name(weather):
    weather.preset = "unseen"
    weather.picture = "night-mist"
    assert weather.current().name == "night-mist"
    assert weather.sun_altitude == pytest.approx(math.radians(-25))
    assert weather.picture == "night-mist"


def test_the_job_gets_the_list_or_the_sliders(addon, weather):
    weather.preset = "unseen"
    assert weather.chosen() == (gallery.shipped("unseen"), ())
    weather.used = "ONE"
    weather.rain = 12.5
    (only,) = weather.chosen()[0]
    assert only == weather.current()
    assert (only.name, only.precipitation) == ("my-weather", 12.5)


def test_a_file_of_the_users_own(addon, weather, tmp_path):
    weather.preset = "OWN"
    assert "No list of weathers" in refusal(weather.chosen)
    assert "choose another list" in refusal(addon.ops.rauca.next_weather)
    weather.file = str(tmp_path / "none.json")
    assert "no such file" in refusal(weather.chosen)
    save_weathers(tmp_path / "mine.json", [FOG])
    weather.file = str(tmp_path / "mine.json")
    assert weather.current() == FOG
    assert weather.chosen() == ((FOG,), [])


def test_a_street_comes_and_goes_around_the_vehicle(addon, weather):
    before = blocks()
    assert addon.ops.rauca.set_up_street() == {"FINISHED"}
    assert len(weather.street.objects) > 10
    assert "remove it first" in refusal(addon.ops.rauca.set_up_street)
    weather.pick(Weather("night", -30.0))
    addon.ops.rauca.show_weather()
    lamps = [thing for thing in weather.street.objects if thing.type == "LIGHT"]
    assert lamps
    assert all(lamp.data.energy > 0 for lamp in lamps)
    addon.ops.rauca.remove_weather()
    assert all(lamp.data.energy == 0 for lamp in lamps)
    assert addon.ops.rauca.remove_street() == {"FINISHED"}
    assert blocks() == before


def test_the_street_stands_as_in_the_dataset(addon, weather):
    """Seen from the vehicle, houses and sun are where the data set's frames of that place have them."""
    job = addon.data.scenes.new("job")
    town = Town(job, addon.context.scene.rauca.dataset.seed)
    town.enter(2)
    in_job = np.linalg.inv(town.pose(2)) @ np.array(addon.data.objects["rauca town"].matrix_world)
    addon.data.batch_remove(list(job.collection.all_objects))
    weather.place = 3
    addon.ops.rauca.set_up_street()
    np.testing.assert_allclose(np.array(addon.data.objects["rauca town"].matrix_world), in_job, atol=1e-4)
    heading = math.degrees(math.atan2(town.pose(2)[1, 0], town.pose(2)[0, 0]))
    assert math.cos(math.radians(weather.street_turn_deg + heading)) == pytest.approx(1.0)


def test_what_the_artist_put_into_the_street_stays(addon, weather):
    addon.ops.rauca.set_up_street()
    cube = addon.data.objects["Cube"]
    weather.street.objects.link(cube)
    addon.context.scene.collection.children["Collection"].objects.unlink(cube)
    cube.data.materials[0] = addon.data.materials["rauca asphalt"]
    addon.ops.rauca.remove_street()
    assert cube.name in addon.context.scene.objects
    assert "rauca asphalt" in addon.data.materials


def test_undo_takes_the_weather_back(addon, weather):
    addon.context.preferences.edit.use_global_undo = True
    addon.ops.ed.undo_push(message="before")
    world = addon.context.scene.world.name
    addon.ops.rauca.show_weather()
    addon.ops.ed.undo_push(message="shown")
    addon.ops.ed.undo()
    assert addon.context.scene.world.name == world
    assert not addon.context.scene.rauca.weather.shown.on
    addon.ops.ed.redo()
    assert addon.context.scene.rauca.weather.shown.on
    assert addon.ops.rauca.remove_weather() == {"FINISHED"}
    assert addon.context.scene.world.name == world


def test_a_saved_file_still_knows_what_was_there(addon, weather, tmp_path):
    world = addon.context.scene.world.name
    addon.ops.rauca.show_weather()
    addon.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shown.blend"))
    addon.ops.wm.open_mainfile(filepath=str(tmp_path / "shown.blend"))
    assert addon.ops.rauca.remove_weather() == {"FINISHED"}
    assert addon.context.scene.world.name == world
    assert not [thing.name for thing in addon.data.objects if "rauca" in thing.name]


def test_the_panels_words(addon, weather, tmp_path):
    assert (state(addon.context).kind, state(addon.context).words) == ("ready", "3 weathers for the dataset")
    weather.used = "ONE"
    assert state(addon.context).kind == "done"
    assert state(addon.context).words == "One weather for the dataset: clear day"
    weather.used, weather.preset = "LIST", "OWN"
    assert state(addon.context).kind == "missing"
    (tmp_path / "broken.json").write_text("{")
    weather.file = str(tmp_path / "broken.json")
    assert state(addon.context).words == "The file of weathers cannot be read; choose another"


def test_the_ground_lies_under_the_vehicle_while_there_is_no_street(addon, weather):
    addon.ops.rauca.show_weather()
    ground = weather.shown.ground
    assert not ground.hide_render
    assert ground.location.z == pytest.approx(-0.01)
    hit, place, *_ = addon.context.scene.ray_cast(
        addon.context.evaluated_depsgraph_get(), (300.0, 5.0, 9.0), (0, 0, -1)
    )
    assert hit
    assert place.z == pytest.approx(-0.01, abs=1e-4)
    weather.ground = False
    assert ground.hide_render
    assert ground.hide_viewport
    weather.ground = True
    weather.street = addon.data.collections.new("a street")
    weather.refresh()
    assert ground.hide_render
    addon.ops.rauca.remove_weather()
    assert "rauca ground" not in {
        block.name for kind in ("objects", "meshes", "materials") for block in getattr(addon.data, kind)
    }


def test_rain_in_the_viewport_is_the_frames_rain():
    assert rain_picture(Weather("dry", 40.0), 1.5) is None
    drizzle, heavy = (rain_picture(Weather("w", 40.0, precipitation=amount), 1.5) for amount in (20.0, 90.0))
    assert heavy.shape == (360, 540, 4)
    assert 0.0 < drizzle[..., 3].mean() < heavy[..., 3].mean() < 0.5
    np.testing.assert_array_equal(heavy[0, 0, :3], rain.drop_radiance(Weather("w", 40.0)))
