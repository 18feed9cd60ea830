"""Labels are not cut off at the sidebar's own width, in English and in German; refusals name buttons, not commands."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import blf
import bpy
import pytest

import blender_addon
from blender_addon import registration
from blender_addon.jobs.child import with_buttons
from blender_addon.translations import words

# Measured on Blender 5.2's window at its own scale, whose sidebar is 292 pixels wide: what a label beside its setting,
# the words of a tick box and a button over the whole width have room for, pixels.
FONT, SIZE = 0, 12
LABEL, TICK, BUTTON, THIRD = 92.0, 117.0, 206.0, 70.0
GERMAN = words("de")
ADD_ON = Path(blender_addon.__file__).parent
# Drawn over the whole width, or with a picture or other words.
ELSEWHERE = {"picture", "origin", "paint", "boxes", "python"}
IN_A_ROW = ("Assign", "Remove", "Select", "Original", "Camouflage", "Baked", "Object", "Collection", "File")


@pytest.mark.parametrize("said", [str, lambda text: GERMAN.get(text, text)], ids=["English", "German"])
def test_labels_fit(addon, said) -> None:
    blf.size(FONT, SIZE)
    room = {said(text): THIRD for text in IN_A_ROW}
    for cls in (cls for module in registration.MODULES for cls in registration.classes_of(module)):
        if issubclass(cls, bpy.types.PropertyGroup):
            room |= dict(_settings(cls, said))
        elif issubclass(cls, bpy.types.Operator):
            room[said(cls.bl_label)] = BUTTON
    cut = {text: blf.dimensions(FONT, text)[0] for text in room if blf.dimensions(FONT, text)[0] > room[text]}
    assert len(room) > 60
    assert not cut


def _settings(cls: type, said) -> Iterator[tuple[str, float]]:
    for found in cls.bl_rna.properties:
        if not found.is_hidden and found.description and found.identifier not in {*ELSEWHERE, "rna_type", "name"}:
            yield said(found.name), TICK if found.type == "BOOLEAN" else LABEL


def test_no_refusal_names_an_option_of_the_command_line() -> None:
    """Whatever the add-on or its jobs refuse: the window has buttons and settings."""
    told = [text for path in (*ADD_ON.glob("scene/**/*.py"), *ADD_ON.glob("*.py")) for text in _refusals(path)]
    told += [text for path in ADD_ON.glob("jobs/*.py") for text in _refusals(path)]
    assert len(told) > 60
    assert [text for text in told if "--" in with_buttons(text)] == []
    assert with_buttons("camouflage.json: is after 60 steps; give --steps 100") == (
        "camouflage.json: is after 60 steps; give Steps 100"
    )


def _refusals(path: Path) -> Iterator[str]:
    """The sentences of a module that is shown when something is refused; what is filled in is left out."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) == "RaucaError":
            for given in node.args:
                parts = [part.value for part in ast.walk(given) if isinstance(part, ast.Constant)]
                yield "".join(part for part in parts if isinstance(part, str))
