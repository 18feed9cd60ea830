"""What the operators share that start a child process and leave it to the timer."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..background import watch
from ..background.endings import Ending
from ..core import contract
from .operator import RaucaOperator


class BackgroundOperator(RaucaOperator):
    """Base of an operator that starts a job; the subclass also derives from ``bpy.types.Operator``.

    In a window it returns at once and the panel shows the job. A script without a window has no timer: there it returns
    when the job has ended, unless ``wait`` is given as False.

    A subclass gives ``job``, its name, and ``running``, why it cannot be started twice.
    """

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
