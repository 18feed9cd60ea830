"""Render a dataset in other Blender processes, so that the window stays responsive."""

from __future__ import annotations

import contextlib
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .. import compat
from ..background import watch
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
        contract.save_job(scratch / "job.json", dataset_job(context, folder, scratch / "vehicle"))
        task = DatasetTask(folder, child_command(scratch / "job.json"), scratch)
        workers = settings.workers
        watch.begin(JOB, task, lambda job: _learn_pace(folder, workers))


def dataset_job(context: bpy.types.Context, out: Path, vehicle: Path) -> contract.MakeDataset:
    """What the panels of steps 1 to 4 ask for.

    Args:
        out: folder of the dataset.
        vehicle: folder of the saved vehicle.

    Raises:
        RaucaError: the list of weathers cannot be read, or the settings ask for what no dataset can be.
    """
    steps = context.scene.rauca
    settings = steps.dataset
    weathers, notes = steps.weather.chosen()
    plan = contract.Plan(
        name=out.name,
        vehicle_name="",
        atlas_id="",
        size=settings.size,
        quality=contract.Quality(settings.samples, denoise=settings.denoise),
        light=settings.light,
        weathers=tuple(weathers),
        ring=steps.cameras.ring(context),
        locations=settings.locations,
        reference_srgb=contract.REFERENCE_SRGB,
        min_visible=contract.MIN_VISIBLE,
        seed=settings.seed,
        blender="",
    )
    plan.check(rpt("Generate Dataset"))
    return contract.MakeDataset(
        out=out,
        plan=plan,
        vehicle=contract.VehicleSource(str(vehicle)),
        frames=tuple(contract.balanced_frames(plan, settings.part)) if settings.part else None,
        workers=settings.workers,
        retry_quarantined=settings.retry,
        device=settings.device.lower(),
        notes=tuple(notes),
    )


def _learn_pace(folder: Path, workers: int) -> None:
    """The next estimate of step 3 builds on this job; a job that ended without frames teaches nothing."""
    with contextlib.suppress(contract.RaucaError):
        timing.learn(folder, workers)


CLASSES = (RAUCA_OT_generate_dataset,)
