"""From an empty scene to a baked camouflage, with the mouse alone, in a real Blender's window.

The steps build on each other: run them in order and stop at the first that fails (``make test-gui`` does). What is
asserted comes from the files on disk and from Blender's data, and a screenshot of every step is kept.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rauca_core.contract import Camouflage, frame_states, load_camouflage, read_plan, save_camouflage

from .blender import Blender
from .gaps import DEAF_S, Gaps, percentile
from .sidebar import Sidebar
from .way import Way

FRAMES, STEPS = 12, 50  # of the demo scene
SAMPLES = 16
PATIENCE_S = 1500.0  # software rendering beside whatever else the machine does


@pytest.fixture(scope="session")
def figures(desk: Sidebar) -> Iterator[dict[str, str]]:
    """What was measured, kept beside the screenshots even when a later step fails."""
    found = {"Blender": desk.blender.ask("value = bpy.app.version_string")}
    yield found
    (desk.blender.outside / "gaps.json").write_text(json.dumps(found, indent=1), encoding="utf-8")


@pytest.fixture(scope="session")
def way(desk: Sidebar) -> Way:
    return Way(desk.screen)


def test_the_tab_is_there_and_nothing_else(desk: Sidebar) -> None:
    """No step is ticked before anything was done, and a new file's default cube stands without rings of cameras."""
    blender = desk.blender
    desk.show()
    before = blender.shoot("0-start")
    labels = blender.ask("value = [getattr(bpy.types, f'RAUCA_PT_{n}').bl_label for n in " + repr(ORDER) + "]")
    assert all(labels)
    assert "done" not in {kind for kind, _ in states(blender)}
    assert blue(before) < 50


def test_step_1_adds_the_sedan(desk: Sidebar) -> None:
    blender, screen = desk.blender, desk.screen
    screen.move(*blender.away())
    screen.key("a")
    screen.key("Delete")  # the default cube stands where the car goes
    blender.wait(lambda: blender.ask("value = not len(bpy.context.scene.objects)"), "an empty scene")
    # A button that opens a menu does not say what it is: it lies below the field "Front".
    x, y = desk.find("front")
    screen.click(x, y + 26)
    time.sleep(2)  # its pictures are read
    screen.shoot(blender.scratch / "1-menu.png")
    screen.key("s")  # the underlined letter of "Sedan"
    blender.wait(lambda: chosen(blender) == "sedan", "the sedan")
    blender.shoot("1-vehicle")
    assert blender.ask("value = 'sedan' in bpy.context.scene.objects")
    assert blender.ask("value = 'sedan' in bpy.context.collection.objects")  # the active one, as Blender's own meshes
    assert state(blender, 1)[0] == "done"
    # The panel Paint follows the last button and the state's two lines.
    desk.unfold("rauca.demo_scene(", "tint", skip=2 * ROW)
    assert tinted(blender.shoot("1-untinted")) < 50  # off by default
    desk.press("tint", lambda: blender.settings("vehicle.tint"))
    assert tinted(blender.shoot("1-tinted")) > 2000
    desk.press("tint", lambda: not blender.settings("vehicle.tint"))
    assert tinted(blender.shoot("1-untinted")) < 50


def test_step_2_shows_a_weather(desk: Sidebar) -> None:
    blender = desk.blender
    desk.open(2)
    desk.press("rauca.show_weather(", lambda: blender.settings("weather.shown.on"))
    desk.press("rauca.next_weather(", lambda: blender.settings("weather.picked") != "clear-day")
    assert blender.ask("value = bpy.context.scene.world.name") == blender.settings("weather.shown.world.name")
    desk.unfold("puddles", "fog_falloff")
    blender.shoot("2-more")
    # Use Cycles, then Rendered View.
    desk.press("engine", lambda: blender.ask("value = bpy.context.scene.render.engine") == "CYCLES")
    desk.press("type", lambda: shading(blender) == "RENDERED")
    assert not blender.ask("value = bpy.context.scene.rauca.weather.shown.ground.hide_viewport")
    assert dark(shoot_rendered(desk, "2-weather")) < 0.5  # no void around the vehicle


def test_step_3_looks_through_a_view_and_back(desk: Sidebar) -> None:
    blender = desk.blender
    desk.open(3)
    blender.shoot("3-cameras")
    for name, count in (("azimuths", 2), ("elevations", 1), ("distances", 1)):
        desk.enter(name, count)
    assert blue(blender.shoot("3-rings")) > 200
    assert blender.ask("value = len(bpy.context.scene.rauca.cameras.ring())") == 2
    where = f"{VIEW}\nvalue = [round(x, 3) for row in space.region_3d.view_matrix for x in row]"
    before, through = blender.ask(where), f"{VIEW}\nvalue = space.region_3d.view_perspective == 'CAMERA'"
    desk.press("rauca.look_through(step=1", lambda: blender.ask(through))
    assert blender.settings("cameras.looking")
    blender.shoot("3-view")
    desk.press("rauca.leave_view(", lambda: not blender.settings("cameras.looking"))
    blender.wait(lambda: blender.ask(where) == before, "the user's own view")


def test_one_click_adds_the_demo_scene(desk: Sidebar, way: Way) -> None:
    """A stranger's way begins here: all that follows happens in this scene."""
    blender = desk.blender
    desk.open(1)
    way.begin()
    desk.press("rauca.demo_scene(", lambda: blender.ask("value = bpy.context.scene.name") == "Rauca Demo")
    way.note("demo scene")
    time.sleep(60)  # shaders are compiled
    assert chosen(blender).startswith("sedan")  # another one is in the file's first scene
    assert blender.ask("value = bpy.context.scene.rauca.weather.shown.on")
    assert blender.ask("value = bpy.context.scene.camera is not None")
    assert "done" not in {kind for kind, _ in states(blender)[3:]}
    desk.open(2)
    blender.shoot("d2-weather")
    desk.open(3)
    desk.press("overlay", lambda: blender.settings("cameras.overlay"))
    blender.shoot("d3-cameras")
    desk.press("overlay", lambda: not blender.settings("cameras.overlay"))
    desk.open(1)
    blender.shoot("d1-vehicle")
    look(desk, "SOLID")


def test_a_photograph_is_looked_at_marked_and_left(desk: Sidebar) -> None:
    """Without a Python: that is needed for the fit alone."""
    blender, screen = desk.blender, desk.screen
    wide, high = 320, 240
    picture = np.zeros((high, wide, 3), np.uint8)
    picture[..., 1], picture[..., 2] = np.linspace(0, 255, wide), np.linspace(0, 255, high)[:, None]
    cv2.imwrite(str(blender.outside / "photograph.png"), picture)
    settings = "kept = bpy.context.scene.rauca.photograph\n"
    words = "value = own('steps.photograph.panel').state(bpy.context).words"
    marking = "value = own('steps.photograph.marking').RAUCA_OT_mark_points.under_way"
    desk.open(7)
    desk.unfold("study", "mask", skip=ROW)
    assert blender.ask(words) == "Choose a photograph first"
    desk.enter("file", str(blender.scratch / "photograph.png"))
    assert blender.ask(words) == "Look at the photograph first"
    looking = settings + "value = kept.camera is not None and bpy.context.scene.camera == kept.camera"
    desk.press("rauca.look_at_photograph(", lambda: blender.ask(looking))
    assert blender.ask(words) == "Choose a folder for the photograph"
    blender.shoot("p-looked")
    desk.press("rauca.mark_points(", lambda: blender.ask(marking))
    left, top, width, height = blender.region("WINDOW")
    middle = left + width / 2, top + height / 2  # the first look is at the vehicle's middle
    screen.click(*middle)
    alone = settings + "value = kept.camera.data.background_images[0].alpha == 1.0"
    blender.wait(lambda: blender.ask(alone), "the photograph alone")
    screen.click(*middle)
    marks = settings + "value = [[*mark.vehicle_m, *mark.pixel] for mark in kept.marks]"
    blender.wait(lambda: blender.ask(marks), "a mark")
    screen.key("Escape")
    blender.wait(lambda: not blender.ask(marking), "the end of marking")
    ((x, y, z, column, row),) = blender.ask(marks)
    assert max(abs(x), abs(y), abs(z)) < 3.0  # metres: on the sedan
    assert abs(column - wide / 2) < 3
    assert abs(row - high / 2) < 3
    assert blender.ask(words).startswith("1 of at least 6 points are marked")
    blender.shoot("p-marked")
    left_it = settings + "value = kept.camera is None"
    desk.press("rauca.leave_photograph(", lambda: blender.ask(left_it))
    assert blender.ask("value = bpy.context.scene.camera == bpy.context.scene.rauca.cameras.camera")
    assert blender.ask(settings + "value = len(kept.marks)") == 1


def test_step_4_generates_a_dataset(desk: Sidebar, figures: dict[str, str], way: Way) -> None:
    blender = desk.blender
    desk.open(4)
    desk.enter("samples", SAMPLES)  # without a denoiser the demo scene asks for more than a test has time for
    folder = outside(blender, blender.settings("dataset.folder"))
    figures["idle"] = str(idle(blender))
    way.begin()
    places = [desk.find("rauca.generate_dataset(")]
    desk.press("rauca.generate_dataset(", lambda: begun(blender, "dataset"))
    way.note("dataset: press")
    figures["generating"] = measured(desk, "dataset", "4-generating")
    way.note(f"dataset: {FRAMES} frames rendered")
    shoot_preview(desk, "4-dataset")
    places.append(desk.find("rauca.generate_dataset("))
    assert abs(places[0][1] - places[1][1]) < 5  # no button moves under the mouse; the middle is found to some pixels
    desk.unfold("rauca.generate_dataset(", "workers", skip=10 * ROW)  # buttons, the picture, the state
    blender.shoot("4-more")
    planned = read_plan(folder).frames()
    assert len(planned) == FRAMES
    ended = [frame_states(folder).get(frame.id) for frame in planned]
    assert set(ended) <= {"done", "occluded"}  # a parked car stands before some views
    assert ended.count("done") > FRAMES / 2
    for image in folder.glob("frames/*/image.png"):
        assert cv2.imread(str(image)).std() > 5  # a picture, not a grey field
    assert state(blender, 4)[0] == "done"


def test_step_5_optimizes(desk: Sidebar, figures: dict[str, str], way: Way) -> None:
    python = os.environ.get("RAUCA_PYTHON")
    if not python:
        pytest.skip("no Python with torch for this Blender (set RAUCA_PYTHON)")
    blender = desk.blender
    desk.open(5)
    blender.shoot("5-python")
    way.begin()
    desk.enter("python", a_python(blender, python))
    checked = "preferences = own('preferences').preferences(bpy.context)\nvalue = preferences.verdict"
    desk.press("rauca.check_python(", lambda: blender.ask(checked), PATIENCE_S)
    way.note("a Python that is there: chosen and checked")
    assert blender.ask("value = own('preferences').preferences(bpy.context).ready"), blender.ask(checked)
    blender.shoot("5-ready")
    assert blender.settings("optimize.steps") == STEPS
    folder = blender.settings("optimize.folder")
    desk.press("rauca.optimize(", lambda: begun(blender, "optimize"))
    way.note("optimize: press")
    running = "found = own('jobs.watch').job('optimize')\nvalue = found.phase == 'running' and found.done > 2"
    blender.wait(lambda: blender.ask(running), "some steps", PATIENCE_S)
    unfinished = f"{folder}/unfinished.json"
    desk.press("rauca.use_now(", lambda: blender.settings("camouflage.file") == unfinished, PATIENCE_S)
    load_camouflage(outside(blender, unfinished))
    figures["optimizing"] = measured(desk, "optimize", "5-optimizing")
    way.note(f"optimize: {STEPS} steps, one use of Use Now")
    shoot_preview(desk, "5-optimized")
    made, _ = load_camouflage(outside(blender, folder) / "camouflage.json")
    assert made.atlas_id == read_plan(outside(blender, blender.settings("dataset.folder"))).atlas_id
    assert blender.settings("camouflage.file") == f"{folder}/camouflage.json"
    assert state(blender, 5)[0] == "done"


def test_step_6_applies_the_camouflage(desk: Sidebar, way: Way) -> None:
    blender = desk.blender
    desk.open(6)
    if made := blender.settings("camouflage.file"):
        way.begin()
        desk.press("rauca.apply_camouflage(", lambda: coat(blender))
        way.note("apply")
        assert state(blender, 6)[0] == "done"
        desk.screen.move(*blender.away())
        desk.screen.key("ctrl+z")
        blender.wait(lambda: not coat(blender), "undo of what was applied")
        assert blender.settings("camouflage.file") == made  # what the job filled in stays
    desk.enter("file", str(blender.scratch / a_camouflage(blender).name))  # one that differs to the eye
    desk.press("rauca.apply_camouflage(", lambda: coat(blender).get("name") == "patches")
    assert coat(blender)["shown"] == "CAMOUFLAGE"
    desk.press("rauca.show_paint(which='ORIGINAL'", lambda: coat(blender)["shown"] == "ORIGINAL")
    original = shoot_preview(desk, "6-original")
    desk.press("rauca.show_paint(which='CAMOUFLAGE'", lambda: coat(blender)["shown"] == "CAMOUFLAGE")
    seen = "the camouflage in the preview"  # Blender 5 draws without it until its shader is compiled
    blender.wait(lambda: unlike(original, shoot_preview(desk, "6-camouflage")), seen)
    desk.screen.move(*blender.away())
    desk.screen.key("ctrl+z")
    blender.wait(lambda: coat(blender)["shown"] == "ORIGINAL", "undo")
    desk.screen.key("ctrl+shift+z")
    blender.wait(lambda: coat(blender)["shown"] == "CAMOUFLAGE", "redo")
    assets = "value = [t.name for t in bpy.data.node_groups if t.asset_data]"
    desk.press("rauca.mark_asset(", lambda: blender.ask(assets))
    assert blender.ask(assets) == ["patches (sedan)"]
    assert state(blender, 6)[0] == "done"


def test_step_7_evaluates_and_leads_to_the_worst_view(desk: Sidebar, figures: dict[str, str], way: Way) -> None:
    if not os.environ.get("RAUCA_PYTHON"):
        pytest.skip("no Python with torch for this Blender (set RAUCA_PYTHON)")
    blender = desk.blender
    desk.open(7)
    blender.shoot("7-ready")
    way.begin()
    desk.press("rauca.evaluate(", lambda: begun(blender, "evaluate"))
    way.note("evaluate: press")
    figures["evaluating"] = measured(desk, "evaluate", "7-evaluating")
    way.note("evaluate: 4 views in two paints")
    blender.shoot("7-evaluated")
    assert blender.settings("camouflage.study") == blender.settings("evaluate.folder")
    desk.press("rauca.evaluated_view(step='WORST'", lambda: blender.settings("camouflage.frame"))
    way.note("worst view")
    blender.shoot("7-worst")
    mine = "value = bpy.context.scene.camera == bpy.context.scene.rauca.cameras.camera"
    assert not blender.ask(mine)
    assert blender.ask("value = len(bpy.context.scene.camera.data.background_images)") == 1
    desk.press("rauca.leave_evaluated_view(", lambda: blender.ask(mine))


def test_step_8_bakes_and_exports(desk: Sidebar, figures: dict[str, str], way: Way) -> None:
    blender = desk.blender
    desk.open(8)
    assert state(blender, 8) == ["missing", "The vehicle has no other UV layer yet: press New UV Layer"]
    way.begin()
    layer = desk.press("rauca.new_uv_layer(", lambda: blender.settings("bake.layer"))
    desk.turn("size", -1)
    assert blender.settings("bake.size") == "1024"
    blender.ask("heart.take()")
    desk.press("rauca.bake(", lambda: blender.settings("bake.file"), PATIENCE_S)
    way.note("UV layer, bake")
    gaps = Gaps.of(blender.ask("value = heart.take()"))
    figures["baking"] = str(gaps)
    MEASURED["bake"] = gaps
    shoot_preview(desk, "8-baked")
    (png,) = outside(blender, blender.settings("bake.folder")).glob("*.png")
    texture = cv2.imread(str(png))
    assert texture.shape == (1024, 1024, 3)
    assert texture.std() > 5
    kind, words = state(blender, 8)  # a bake that looks different is not ticked
    looks_alike = blender.settings("bake.decibels") >= blender.ask("value = own('steps.bake').LEAST_DB")
    assert (kind == "done") == looks_alike, words
    assert blender.ask("value = [i.name for i in bpy.data.images if i.packed_file and i.size[0] == 1024]")
    assert layer in blender.ask("value = [u.name for u in bpy.context.scene.rauca.camouflage.anchor.data.uv_layers]")
    windows = "value = len(bpy.context.window_manager.windows) > 1"
    desk.press("rauca.export_glb(", lambda: blender.ask(windows))
    time.sleep(3)
    blender.screen.shoot(blender.scratch / "8-export.png")
    desk.screen.key("Return")
    glb = png.with_suffix(".glb")
    blender.wait(glb.is_file, "the GLB")
    way.note("export")
    figures["a stranger's way"] = str(way)
    assert glb.read_bytes()[:4] == b"glTF"


def test_panels_speak_plainly(desk: Sidebar) -> None:
    """No digest, no option of a command line, no path in a sentence."""
    for number, (_, words) in enumerate(states(desk.blender), 1):
        assert words
        assert not re.search(r"[0-9a-f]{12}|--|PSNR|/\w+/", words), (number, words)


def test_it_speaks_german(desk: Sidebar) -> None:
    blender = desk.blender
    told = blender.ask(
        "bpy.context.preferences.view.language = 'de_DE'\n"
        "value = [bpy.app.translations.pgettext_iface('Apply Camouflage', 'Operator'),"
        " bpy.app.translations.pgettext_rpt('{name} is on {vehicle}')]"
    )
    for number in range(1, len(ORDER) + 1):
        desk.open(number)
        blender.shoot(f"9-german-{number}")
    assert told == ["Tarnung anwenden", "{name} ist auf {vehicle}"]
    # Words that Blender says in another sense.
    senses = (
        "paint = bpy.types.RAUCA_PT_vehicle_paint\n"
        "fov = bpy.context.scene.rauca.cameras.bl_rna.properties['fov']\n"
        "said = bpy.app.translations.pgettext_iface\n"
        "value = [said(paint.bl_label, paint.bl_translation_context), said(fov.name, fov.translation_context)]"
    )
    assert blender.ask(senses) == ["Lack", "Sichtfeld"]


def test_the_window_stays_awake() -> None:
    """Judged last, so that a slow moment does not hide what else works."""
    assert MEASURED
    for name, gaps in MEASURED.items():
        assert max(gaps.own) < DEAF_S, f"{name}: {gaps}"
        # A bake lasts seconds and shows every per cent: drawing by software alone is more than 1 % of its turns.
        assert name == "bake" or percentile(gaps.busy, 99) < DEAF_S, f"{name}: {gaps}"


ORDER = ("vehicle", "weather", "cameras", "dataset", "optimize", "camouflage", "evaluate", "bake")
ROW = 26  # pixels, of a button and the gap below it
MEASURED: dict[str, Gaps] = {}
PATCHES_BGR = ((150, 200, 215), (60, 120, 90), (45, 75, 125), (30, 40, 35))  # sand, green, brown, black
SEEN = slice(440, 540), slice(500, 720)  # rows and columns of the screen: the vehicle as the demo scene shows it
VIEW = "space = view3d()[1].spaces[0]"


def chosen(blender: Blender) -> str:
    return str(blender.ask("found = bpy.context.scene.rauca.vehicle.object\nvalue = found.name if found else ''"))


def shading(blender: Blender) -> str:
    return str(blender.ask(f"{VIEW}\nvalue = space.shading.type"))


def coat(blender: Blender) -> dict[str, Any]:
    """What the vehicle wears; empty without a camouflage."""
    code = (
        "found = bpy.context.scene.rauca.camouflage.coat\n"
        "value = {'shown': own('scene.coating').Coat(found).shown, 'name': found['rauca_camouflage']} if found else {}"
    )
    return dict(blender.ask(code))


def shoot_rendered(desk: Sidebar, name: str) -> Path:
    """A screenshot of the rendered view; leaves the solid one."""
    desk.screen.move(*desk.blender.away())
    time.sleep(25)  # samples come in
    desk.screen.shoot(desk.blender.scratch / f"{name}.png")
    look(desk, "SOLID")
    return desk.blender.outside / f"{name}.png"


def unlike(one: Path, other: Path) -> bool:
    """Whether two screenshots differ where the vehicle is, by more than what few samples leave of noise."""
    height, width = SEEN
    middles = [cv2.imread(str(path))[height, width].astype(float) for path in (one, other)]
    return float(np.abs(middles[0] - middles[1]).mean()) > 15.0


def look(desk: Sidebar, wanted: str) -> None:
    """Another shading of the viewport, by Blender's own pie menu."""
    desk.screen.move(*desk.blender.away())
    desk.screen.key("z")
    time.sleep(1)
    desk.screen.key({"SOLID": "6", "MATERIAL": "2"}[wanted])
    desk.blender.wait(lambda: shading(desk.blender) == wanted, f"the view {wanted}")


def shoot_preview(desk: Sidebar, name: str) -> Path:
    """A screenshot of the material preview; leaves the solid view, which software draws many times faster."""
    look(desk, "MATERIAL")
    picture = desk.blender.shoot(name)
    look(desk, "SOLID")
    return picture


def begun(blender: Blender, job: str) -> bool:
    return bool(blender.ask(f"value = own('jobs.watch').job({job!r}) is not None"))


def idle(blender: Blender) -> Gaps:
    """Gaps while nothing runs but the sidebar is drawn as often as a job has it drawn: what Blender itself takes."""
    blender.screen.move(*blender.away())
    blender.ask("heart.take()")
    for _ in range(100):
        blender.ask("own('jobs.watch').redraw()")
        time.sleep(0.1)
    return Gaps.of(blender.ask("value = heart.take()"))


def measured(desk: Sidebar, job: str, picture: str) -> str:
    """Wait for a job while the window's pulse is taken; a screenshot when it is half done."""
    blender = desk.blender
    blender.screen.move(*blender.away())
    found = f"found = own('jobs.watch').job({job!r})\n"
    blender.ask("heart.take()")
    half = found + "value = found.fraction >= 0.5 or not found.alive"
    blender.wait(lambda: blender.ask(half), "half of the job", PATIENCE_S)
    blender.screen.shoot(blender.scratch / f"{picture}.png")
    blender.wait(lambda: blender.ask(found + "value = not found.alive"), "the job's end", PATIENCE_S)
    gaps = Gaps.of(blender.ask("value = heart.take()"))
    MEASURED[job] = gaps
    told = blender.ask(found + "value = [found.phase, found.ending, found.notes]")
    assert told[0] == "done", told
    return str(gaps)


def a_camouflage(blender: Blender) -> Path:
    """Patches of four colors that fit the sedan, written beside the scratch folder's other files."""
    plan = read_plan(outside(blender, blender.settings("dataset.folder")))
    noise = np.random.default_rng(0).standard_normal((512, 512, len(PATCHES_BGR)))
    texels = np.array(PATCHES_BGR, np.uint8)[cv2.GaussianBlur(noise, (0, 0), 12).argmax(axis=2)]
    path = blender.outside / "patches.json"
    png = cv2.imencode(".png", texels)[1].tobytes()
    save_camouflage(path, Camouflage("patches", plan.vehicle_name, plan.atlas_id, 512, "random"), png)
    return path


def a_python(blender: Blender, python: str) -> str:
    """The Python under a name of the scratch folder's, so that no picture shows a place of this machine."""
    here = blender.outside / "python"
    here.write_text(f'#!/bin/sh\nexec {shlex.quote(python)} "$@"\n', encoding="utf-8")
    here.chmod(0o755)
    return str(blender.scratch / "python")


def outside(blender: Blender, path: str) -> Path:
    """A path of Blender's, seen from here."""
    return blender.outside / Path(path).relative_to(blender.scratch)


def states(blender: Blender) -> list[list[str]]:
    """Kind and words of each step's state, in order."""
    code = f"value = [getattr(bpy.types, f'RAUCA_PT_{{n}}').step_state(bpy.context) for n in {ORDER!r}]\n"
    return list(blender.ask(code + "value = [[found.kind, found.words] for found in value]"))


def state(blender: Blender, number: int) -> list[str]:
    return states(blender)[number - 1]


def blue(picture: Path) -> int:
    """Pixels of the viewport in the color of the rings' cameras; the manipulator at its top is left out."""
    seen = cv2.imread(str(picture))[250:850, 60:700].astype(int)
    return int(((seen[..., 0] - seen[..., 2] > 40) & (seen[..., 1] - seen[..., 2] > 15)).sum())


def tinted(picture: Path) -> int:
    """Pixels of the viewport in the color that step 1 tints paint with."""
    seen = cv2.imread(str(picture))[250:850, 60:700].astype(int)
    return int(((seen[..., 2] - seen[..., 1] > 40) & (seen[..., 0] - seen[..., 1] > 40)).sum())


def dark(picture: Path) -> float:
    """Share of the viewport that is black."""
    return float((cv2.imread(str(picture))[250:850, 60:700].max(axis=2) < 20).mean())
