"""Render a dataset in other Blender processes, so that the window stays responsive."""

from __future__ import annotations

import contextlib
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .. import compat
from ..background import watch
from ..background.dataset_arguments import dataset_arguments
from ..background.dataset_task import DatasetTask
from ..background.folders import chosen_folder, job_folder, refuse_foreign
from ..child import child_command
from ..core import contract
from ..ui.cameras import timing
from .background_operator import BackgroundOperator
from .without_denoiser import samples_without_denoiser

JOB = "dataset"


class RAUCA_OT_generate_dataset(BackgroundOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Render every view in every weather to the chosen folder; goes on where an earlier run stopped"""

    bl_idname = "rauca.generate_dataset"
    bl_label = "Generate Dataset"
    job = JOB
    running = "A dataset is being rendered; stop it first"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if not context.scene.rauca.dataset.folder:
            return rpt("Choose a folder for the dataset")
        return super().obstacle(context)

    def begin(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.dataset
        folder = chosen_folder(settings.folder, rpt("the dataset"))
        refuse_foreign(folder, "dataset.json", rpt("dataset"))
        if settings.denoise and not compat.denoiser_is_built_in():
            raise contract.RaucaError(
                rpt(
                    "This Blender was built without a denoiser; turn Denoise off and take {count} samples, or use "
                    "Blender from blender.org"
                ).format(count=samples_without_denoiser(settings.samples))
            )
        vehicle = context.scene.rauca.vehicle.chosen(context)
        scratch = job_folder()
        vehicle.save(scratch / "vehicle")
        arguments = dataset_arguments(context, folder, scratch / "vehicle")
        task = DatasetTask(folder, child_command("make_dataset", arguments), scratch)
        workers = settings.workers
        watch.begin(JOB, task, lambda job: _learn_pace(folder, workers))


def _learn_pace(folder: Path, workers: int) -> None:
    """The next estimate of step 3 builds on this job; a job that ended without frames teaches nothing."""
    with contextlib.suppress(contract.RaucaError):
        timing.learn(folder, workers)


CLASSES = (RAUCA_OT_generate_dataset,)
