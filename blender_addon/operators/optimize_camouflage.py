"""Optimize a camouflage in the external Python, beside the window."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..background import watch
from ..background.folders import chosen_folder, refuse_foreign
from ..background.job import Job
from ..background.optimize_task import HISTORY, OptimizeTask, begun
from ..core import contract
from ..preferences import preferences
from .background_operator import BackgroundOperator
from .generate_dataset import JOB as DATASET_JOB

JOB = "optimize"


class RAUCA_OT_optimize(BackgroundOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Optimize a camouflage on the dataset against the chosen detectors; goes on where an earlier run stopped"""

    bl_idname = "rauca.optimize"
    bl_label = "Optimize"
    job = JOB
    running = "A camouflage is being optimized; stop it first"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        found, steps = preferences(context), context.scene.rauca
        if found is None or not found.python.strip():
            return rpt("Choose the Python in which rauca is installed")
        if not found.ready:
            return rpt("Press Check: the chosen Python is not known to have what it needs")
        if not found.chosen_detectors():
            return rpt("Choose a detector")
        if not steps.optimize.dataset_folder(context):
            return rpt("Choose a dataset")
        if not steps.optimize.folder:
            return rpt("Choose a folder for the camouflage")
        return super().obstacle(context)

    def begin(self, context: bpy.types.Context) -> None:
        settings, found = context.scene.rauca.optimize, preferences(context)
        assert found is not None  # poll
        dataset = Path(bpy.path.abspath(settings.dataset_folder(context))).absolute()
        _check_dataset(dataset)
        folder = chosen_folder(settings.folder, rpt("the camouflage"))
        if not begun(folder) and not (folder / HISTORY).is_file():
            refuse_foreign(folder, "camouflage.json", rpt("camouflage"))
        task = OptimizeTask(folder, _command(settings, found.program(), found.chosen_detectors(), dataset, folder))
        watch.begin(JOB, task, _offer)


def _check_dataset(folder: Path) -> None:
    """Raise :class:`RaucaError` for a folder that cannot be optimized on."""
    making = watch.job(DATASET_JOB)
    if making is not None and making.alive and making.task.folder == folder:
        raise contract.RaucaError(rpt("The dataset is still being rendered; wait for it, or stop it"))
    if not contract.read_plan(folder).light:
        raise contract.RaucaError(
            rpt("{folder}: has no light maps; render it again with Light Maps on, in step 4").format(folder=folder)
        )


def _command(
    settings: bpy.types.PropertyGroup, python: Path, detectors: list[str], dataset: Path, folder: Path
) -> list[str]:
    # -P: a folder named pipelines where Blender was started must not stand in for rauca's.
    command = [str(python), "-P", "-m", "pipelines.optimize_camouflage", str(dataset), "--out", str(folder)]
    for name in detectors:
        command += ["--detector", name]
    command += ["--steps", str(settings.steps), "--batch", str(settings.batch), "--map-size", str(settings.map_size)]
    return [*command, "--seed", str(settings.seed), "--name", settings.title or "rauca", "--json-progress"]


def _offer(job: Job) -> None:
    """Put the finished camouflage into step 6, unless another one is chosen there."""
    scene = bpy.context.scene
    if job.phase == "done" and scene is not None and not scene.rauca.camouflage.file:
        scene.rauca.camouflage.file = str(job.task.folder / "camouflage.json")


CLASSES = (RAUCA_OT_optimize,)
