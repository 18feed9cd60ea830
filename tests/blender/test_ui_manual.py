"""The preferences open the manual, from a checkout and from the built extension."""

from __future__ import annotations

import bpy

import blender_addon.preferences
from blender_addon.preferences import draw_manual
from tools.build_extension import gather


class Row:
    """A layout that keeps the buttons it is asked for."""

    def __init__(self) -> None:
        self.opened: dict[str, Row] = {}
        self.filepath = ""

    def row(self):
        return self

    def operator(self, name, text, **more):
        assert name == "wm.path_open"
        self.opened[text] = Row()
        return self.opened[text]


def pages() -> dict[str, str]:
    """What each button opens."""
    row = Row()
    draw_manual(row)
    return {text: open(button.filepath, encoding="utf-8").read() for text, button in row.opened.items()}


def test_the_preferences_open_the_manual(addon, tmp_path, monkeypatch):
    checkout = pages()
    assert list(checkout) == ["Step by Step", "Glossary"]
    gather(tmp_path / "rauca")
    monkeypatch.setattr(blender_addon.preferences, "__file__", str(tmp_path / "rauca" / "preferences.py"))
    built = pages()
    assert list(built) == list(checkout)
    for name, text in built.items():
        assert "](pictures/" not in text
        assert [line for line in checkout[name].splitlines() if not line.startswith("![")] == text.splitlines()
    monkeypatch.setattr(blender_addon.preferences, "__file__", str(tmp_path / "elsewhere" / "preferences.py"))
    assert pages() == {}
    assert bpy.ops.wm.path_open.get_rna_type().properties["filepath"] is not None
