"""What the operators share: a mistake is reported in one line, and the scene is left as it was."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from bpy.app.translations import pgettext_rpt as rpt
from bpy.app.translations import pgettext_tip as tip

from ..background.endings import with_buttons
from ..core import contract


class RaucaOperator:
    """Base of an operator that does its work at once; the subclass also derives from ``bpy.types.Operator``."""

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        """Why it cannot be pressed at present, translated; empty if it can. Asked for at every redraw."""
        return ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if reason := cls.obstacle(context):
            cls.poll_message_set(reason)  # type: ignore[attr-defined]
        return not reason

    def work(self, context: bpy.types.Context) -> str | None:
        """Do it; returns what to tell the user, if anything.

        Raises:
            RaucaError: a mistake, in words that say what to do; nothing was changed.
        """
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            told = self.work(context)
        except contract.RaucaError as error:
            return self.refuse(error)
        if told:
            self.report({"INFO"}, rpt(told))  # type: ignore[attr-defined]
        return {"FINISHED"}

    def refuse(self, error: contract.RaucaError) -> set[str]:
        """Report a mistake and end."""
        self.report({"ERROR"}, rpt(with_buttons(str(error))))  # type: ignore[attr-defined]
        return {"CANCELLED"}


def tooltip(items: Sequence[tuple[str, str, str]], chosen: str) -> str:
    """The tooltip of a button that does one of an operator's choices: that choice's own words, translated."""
    return tip(next(words for name, _, words in items if name == chosen))
