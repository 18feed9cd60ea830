"""The add-on in other languages, through Blender's own translation."""

from __future__ import annotations

import json
from pathlib import Path

import bpy

# Words that Blender itself says in another sense are looked up here: "Paint" as a verb, "UV Layer" as any layer.
OWN_SENSE = "rauca"
LANGUAGES = Path(__file__).parent / "languages"
NAMES = {"de": ("de_DE", "de")}  # a language as Blender's versions call it


def words(language: str) -> dict[str, str]:
    """What the add-on says, by its English words, from ``languages/<language>.json``; names in braces are the same."""
    sections = json.loads((LANGUAGES / f"{language}.json").read_text(encoding="utf-8"))
    return {english: word for section in sections.values() for english, word in section.items()}


def register() -> None:
    # Buttons of operators are looked up apart from everything else.
    known = bpy.app.translations.contexts
    contexts = (known.default, known.operator_default, OWN_SENSE)
    table = {
        name: {(context, english): word for english, word in words(language).items() for context in contexts}
        for language, names in NAMES.items()
        for name in names
    }
    bpy.app.translations.register(__name__, table)


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
