"""The add-on in other languages, through Blender's own translation."""

from __future__ import annotations

import bpy

from .translations_de import WORDS as GERMAN

CLASSES: tuple[type, ...] = ()
LANGUAGES = {"de_DE": GERMAN, "de": GERMAN}  # by the names that Blender's versions have for them


def register() -> None:
    # Buttons of operators are looked up apart from everything else.
    contexts = (bpy.app.translations.contexts.default, bpy.app.translations.contexts.operator_default)
    table = {
        language: {(context, english): word for english, word in words.items() for context in contexts}
        for language, words in LANGUAGES.items()
    }
    bpy.app.translations.register(__name__, table)


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
