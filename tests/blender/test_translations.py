"""Every text that the add-on shows has a German one, and Blender finds it."""

from __future__ import annotations

import ast
import inspect
import string
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

import blender_addon
from blender_addon import registration
from blender_addon.translations import words

WORDS = words("de")
ADD_ON = Path(blender_addon.__file__).parent
SHOWN = [*ADD_ON.glob("steps/**/*.py"), ADD_ON / "preferences.py"]
SAID_BY_JOBS = [ADD_ON / "jobs" / name for name in ("background.py", "child.py")]
TRANSLATED = {"iface", "rpt", "tip", "RaucaError", "Obstacle"}  # calls whose plain texts are shown
# Names and signs that are the same in every language.
EXEMPT = {"CARLA", "CPU", "GPU", "+X", "-X", "+Y", "-Y"}


@pytest.fixture
def registered() -> Iterator[None]:
    blender_addon.register()
    yield
    blender_addon.unregister()


def test_every_text_has_a_german_one(registered: None) -> None:
    texts = {*class_texts(), *property_texts(), *literal_texts()}
    assert len(texts) > 250  # the search itself works
    assert sorted(texts - set(WORDS) - EXEMPT) == []


def test_no_german_text_is_left_over(registered: None) -> None:
    said = {text for path in ADD_ON.glob("**/*.py") for text in constants(path)}
    assert sorted(set(WORDS) - said - {*class_texts(), *property_texts()}) == []


def test_names_in_braces_survive() -> None:
    for english, german in WORDS.items():
        assert fields(english) == fields(german), english


def class_texts() -> Iterator[str]:
    """Labels and tooltips of operators, menus and panels."""
    for cls in classes():
        if issubclass(cls, (bpy.types.Operator, bpy.types.Menu, bpy.types.Panel)):
            yield cls.bl_label
            yield inspect.cleandoc(cls.__doc__ or "")


def property_texts() -> Iterator[str]:
    """Names, tooltips and menu entries of settings that are shown."""
    for cls in classes():
        if issubclass(cls, (bpy.types.Menu, bpy.types.Panel)):
            continue
        if issubclass(cls, bpy.types.FileHandler):  # which shows nothing of itself
            continue
        shown = cls.bl_rna.properties
        if issubclass(cls, bpy.types.Operator):
            group, name = cls.bl_idname.split(".")
            shown = getattr(getattr(bpy.ops, group), name).get_rna_type().properties
        for found in shown:
            # One without a tooltip is for the add-on itself; numbers in pixels read alike everywhere.
            if found.is_hidden or not found.description or found.identifier in ("rna_type", "name", "bl_idname"):
                continue
            yield from (found.name, found.description)
            if found.type == "ENUM":
                for item in found.enum_items:
                    yield from (text for text in (item.name, item.description) if not text[:1].isdigit())


def literal_texts() -> Iterator[str]:
    """Texts that the code shows by itself: in layouts, states, refusals and reports."""
    for path in SHOWN + SAID_BY_JOBS:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            given = [word.value for word in node.keywords if word.arg in ("text", "heading")]
            if called in TRANSLATED:
                given += node.args
            for value in given:
                if isinstance(value, ast.Constant) and isinstance(value.value, str) and value.value:
                    yield value.value


def classes() -> Iterator[type]:
    for module in registration.MODULES:
        yield from registration.classes_of(module)


def constants(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def fields(text: str) -> set[tuple[str | None, str | None]]:
    return {(name, spec) for _, name, spec, _ in string.Formatter().parse(text) if name is not None}
