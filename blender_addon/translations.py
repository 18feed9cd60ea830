"""The add-on in other languages, through Blender's own translation."""

from __future__ import annotations

import bpy

from .translations_de import WORDS as GERMAN

CLASSES: tuple[type, ...] = ()
# Words that Blender itself says in another sense are looked up here: "Paint" as a verb, "UV Layer" as any layer.
OWN_SENSE = "rauca"
LANGUAGES = {"de_DE": GERMAN, "de": GERMAN}  # by the names that Blender's versions have for them


def register() -> None:
    # Buttons of operators are looked up apart from everything else.
    known = bpy.app.translations.contexts
    contexts = (known.default, known.operator_default, OWN_SENSE)
    table = {
        language: {(context, english): word for english, word in words.items() for context in contexts}
        for language, words in LANGUAGES.items()
    }
    bpy.app.translations.register(__name__, table)


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
