"""What the operators share: a mistake is reported in one line, and the scene is left as it was."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract


class RaucaOperator:
    """Base of an operator that does its work at once; the subclass also derives from ``bpy.types.Operator``."""

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
            self.report({"ERROR"}, rpt(str(error)))  # type: ignore[attr-defined]
            return {"CANCELLED"}
        if told:
            self.report({"INFO"}, rpt(told))  # type: ignore[attr-defined]
        return {"FINISHED"}
