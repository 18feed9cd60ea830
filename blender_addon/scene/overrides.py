"""Settings of the artist's scene that the add-on overrides for a while, and restores.

What was changed is a line of JSON that lives in the file with the settings, so it survives saving, loading and undo:
path of each setting -> [what it was, what it was set to].
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Mapping

import bpy

from ..core import contract, reading

Setting = bool | int | float | str


def override(scene: bpy.types.Scene, overrides: str, values: Mapping[str, Setting]) -> str:
    """Set what ``values`` name, for example ``{"cycles.film_exposure": 2.0}``; returns the overrides to keep.

    A path that this Blender does not have is passed over: engines and versions differ in their settings. A setting
    that the artist changed since it was overridden counts as his own from then on.
    """
    known = _known(overrides)
    for path, value in values.items():
        owner, name = _find(scene, path)
        if owner is None:
            continue
        now = getattr(owner, name)
        before = known[path][0] if path in known and _same(now, known[path][1]) else now
        setattr(owner, name, value)
        known[path] = [before, getattr(owner, name)]
    return json.dumps(known)


def restore(scene: bpy.types.Scene, overrides: str) -> None:
    """Set everything back, but for what the artist has changed in the meantime, or what no override can have been."""
    for path, (before, ours) in _known(overrides).items():
        owner, name = _find(scene, path)
        if owner is not None and _same(getattr(owner, name), ours):
            with contextlib.suppress(TypeError, ValueError, OverflowError):  # a value that Blender never had
                setattr(owner, name, before)


def _known(overrides: str) -> dict[str, list[Setting]]:
    """Path -> what it was, and what it was set to; nothing where a .blend holds no such text."""
    try:
        found = reading.parse_json(overrides, "overrides") if overrides else {}
    except contract.RaucaError:
        return {}
    pairs = found.items() if isinstance(found, dict) else ()
    return {path: pair for path, pair in pairs if _is_override(pair)}


def _is_override(pair: object) -> bool:
    return isinstance(pair, list) and len(pair) == 2 and type(pair[0]) is type(pair[1]) and isinstance(pair[0], Setting)


def _find(scene: bpy.types.Scene, path: str) -> tuple[bpy.types.bpy_struct | None, str]:
    """The owner and name of a setting; None where there is no such setting."""
    *parents, name = path.split(".")
    owner = scene
    for parent in parents:
        owner = getattr(owner, parent, None)
    known = owner.bl_rna.properties if isinstance(owner, bpy.types.bpy_struct) else {}
    return (owner if name in known and not known[name].is_readonly else None), name


def _same(first: Setting, second: Setting) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return math.isclose(first, second, rel_tol=1e-6, abs_tol=1e-9)
    return first == second
