"""For a Blender that was built without a denoiser: as good a picture by more samples."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .operator import RaucaOperator

# Frames of N samples denoised and of 8 N not are equally far from the converged ones, in clear weather by day.
MORE_SAMPLES = 8
LEAST, MOST = 64, 1024


def samples_without_denoiser(samples: int) -> int:
    """Samples that stand in for ``samples`` with denoising."""
    return min(max(samples * MORE_SAMPLES, LEAST), MOST)


class RAUCA_OT_without_denoiser(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Turn denoising off and take so many samples that the frames are as clean; they take longer"""

    bl_idname = "rauca.without_denoiser"
    bl_label = "Render Without Denoising"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("Denoise is off already") if not context.scene.rauca.dataset.denoise else ""

    def work(self, context: bpy.types.Context) -> str | None:
        settings = context.scene.rauca.dataset
        settings.denoise, settings.samples = False, samples_without_denoiser(settings.samples)
        return None


CLASSES = (RAUCA_OT_without_denoiser,)
