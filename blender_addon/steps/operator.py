"""What the operators share: a mistake is reported in one line, and the scene is left as it was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import bpy
from bpy.app.translations import pgettext_rpt as rpt
from bpy.app.translations import pgettext_tip as tip

from ..core import contract
from ..jobs import watch
from ..jobs.endings import Ending, with_buttons

NO_UNDO = {"REGISTER"}  # of an operator that leaves the scene as it is


class RaucaOperator:
    """Base of an operator that does its work at once; the subclass also derives from ``bpy.types.Operator``."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

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


class BackgroundOperator(RaucaOperator):
    """Base of an operator that starts a job; the subclass also derives from ``bpy.types.Operator``.

    In a window it returns at once and the panel shows the job. A script without a window has no timer: there it returns
    when the job has ended, unless ``wait`` is given as False.

    A subclass gives ``job``, its name, and ``running``, why it cannot be started twice.
    """

    bl_options = NO_UNDO
    job: str
    running: str

    wait: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Wait", description="Return only when the job has ended", options={"SKIP_SAVE", "HIDDEN"}
    )

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt(cls.running) if watch.busy(cls.job) else ""

    def begin(self, context: bpy.types.Context) -> None:
        """Start the job with :func:`watch.begin`; raises :class:`RaucaError`."""
        raise NotImplementedError

    def work(self, context: bpy.types.Context) -> str | None:
        self.begin(context)
        watch.redraw()
        given = self.properties.is_property_set("wait")  # type: ignore[attr-defined]
        if not (self.wait if given else bpy.app.background):
            return None
        how = watch.run_to_end(self.job).ending
        return self.outcome(context, how) if how is not None else None

    def outcome(self, context: bpy.types.Context, how: Ending) -> str:
        """What to tell a script that waited; raises :class:`RaucaError` for what went wrong."""
        words = rpt(how.text).format(**how.values)
        if how.phase == "failed":
            raise contract.RaucaError(words)
        return words
