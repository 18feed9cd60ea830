"""Cycles settings, and a render that comes back as an array."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import compat
from ..core import contract
from ..folders import scratch_folder
from .images import image_values

BRIGHTEST_BOUNCE = 10.0  # display whites a path may bring after its first bounce; brighter ones are fireflies


class Crop(NamedTuple):
    """Part of a frame, in pixels; row 0 is at the top, ends are exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def inside(self) -> tuple[slice, slice]:
        """Index of the part in an array (H, W, ...)."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @staticmethod
    def around(mask: NDArray[np.bool_], margin: int) -> Crop | None:
        """The box of a mask (H, W) and ``margin`` pixels around it; None when the mask is empty."""
        rows, columns = np.nonzero(mask)
        if rows.size == 0:
            return None
        height, width = mask.shape
        left, top = max(int(columns.min()) - margin, 0), max(int(rows.min()) - margin, 0)
        return Crop(left, top, min(int(columns.max()) + margin + 1, width), min(int(rows.max()) + margin + 1, height))


def prepare(scene: bpy.types.Scene) -> None:
    """Set what never changes between frames: engine, bounces, display transform, file format."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_persistent_data = True
    render.use_file_extension = False
    render.film_transparent = False
    cycles.device = "CPU"
    cycles.transmission_bounces = cycles.volume_bounces = 2
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5
    cycles.use_auto_tile = False
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    compat.use_single_layer_exr(render.image_settings)


def require_denoiser() -> None:
    """Raise :class:`RaucaError` when this Blender cannot denoise: few-sample frames would be noise."""
    if not compat.has_denoiser():
        raise contract.RaucaError(
            f"Blender {bpy.app.version_string} has no Open Image Denoise; use the bpy wheel or blender.org's build, "
            "or pass --no-denoise with 64 samples or more"
        )


def render_linear(
    scene: bpy.types.Scene, quality: contract.Quality, seed: int, crop: Crop | None = None
) -> NDArray[np.float32]:
    """Render the scene's camera, or a part of its frame; returns (H, W, 4) linear premultiplied RGBA, row 0 at the top.

    A part has the noise that the whole frame has with this seed; only the denoiser sees less. The array goes through
    an uncompressed file in memory: Blender offers no pixels of a render in background mode.
    """
    cycles = scene.cycles
    cycles.samples, cycles.seed = quality.samples, seed % 2**31
    cycles.use_adaptive_sampling = quality.adaptive_threshold > 0
    if quality.adaptive_threshold > 0:
        cycles.adaptive_threshold = quality.adaptive_threshold
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = quality.bounces
    # Cycles clamps before it exposes. A fixed limit would cut into daylight, where white is 20 before exposure, and
    # darken fog, whose light all comes by bounces, by some 4 %.
    cycles.sample_clamp_indirect = BRIGHTEST_BOUNCE / cycles.film_exposure
    cycles.use_denoising = quality.denoise
    if quality.denoise:
        # Filtering the guides fast costs 0.4 dB and saves a third of the time of a small frame.
        cycles.denoiser = "OPENIMAGEDENOISE"
        cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    _set_crop(scene.render, crop)
    with scratch_folder(in_memory=True) as temporary:
        scene.render.filepath = str(temporary / "render.exr")
        with silenced():
            bpy.ops.render.render(write_still=True, scene=scene.name)
        return _read_exr(scene.render.filepath)


def _set_crop(render: bpy.types.RenderSettings, crop: Crop | None) -> None:
    render.use_border = render.use_crop_to_border = crop is not None
    if crop is not None:
        # Blender cuts the product with the resolution off: a hundredth of a pixel keeps it from falling one short.
        width, height, nudge = render.resolution_x, render.resolution_y, 0.01
        render.border_min_x, render.border_max_x = (crop.left + nudge) / width, (crop.right + nudge) / width
        render.border_min_y = (height - crop.bottom + nudge) / height
        render.border_max_y = (height - crop.top + nudge) / height


def _read_exr(path: str) -> NDArray[np.float32]:
    image = bpy.data.images.load(path)
    try:
        image.colorspace_settings.name = "Non-Color"
        return image_values(image).copy()
    finally:
        bpy.data.images.remove(image)


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Send what Blender's C code prints on standard output to nowhere; Python's own output is flushed first."""
    sys.stdout.flush()
    keep = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(keep, 1)
        os.close(keep)
        os.close(nowhere)
