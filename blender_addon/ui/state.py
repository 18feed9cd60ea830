"""Where a step of the work stands, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["missing", "ready", "running", "done"]


@dataclass(frozen=True)
class State:
    """What a step's panel shows first.

    Panels ask for it at every redraw, so whoever makes one reads settings only: no files, no meshes.

    Attributes:
        kind: ``missing`` something, ``ready`` to go on, ``running``, or ``done``.
        words: one short sentence in plain words: what is missing, or what is there. Already in the user's language
            (``bpy.app.translations.pgettext_iface`` on the literal, then ``format``).
    """

    kind: Kind
    words: str
