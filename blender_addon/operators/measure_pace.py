"""Take the estimate of the render time from a dataset that was rendered on this machine."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .. import estimate
from ..core import contract
from ..own_folder import own_folder
from ..ui.cameras import timing
from .operator import RaucaOperator


class RAUCA_OT_measure_pace(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Take the time per frame from the dataset of step 4, if this machine rendered it with as many Blenders as there"""

    bl_idname = "rauca.measure_pace"
    bl_label = "Measure by the Last Dataset"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("Choose a dataset's folder in step 4 first") if not context.scene.rauca.dataset.folder else ""

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.dataset
        folder = Path(bpy.path.abspath(settings.folder))
        measured = estimate.measure(folder, settings.workers)
        if measured is None:
            raise contract.RaucaError(
                rpt("{folder}: fewer than {count} of its frames are timed; render some more first").format(
                    folder=folder, count=estimate.FEWEST
                )
            )
        estimate.remember(measured, own_folder())
        timing.forget()
        return rpt("Measured on {count} frames").format(count=measured.frames)


CLASSES = (RAUCA_OT_measure_pace,)
