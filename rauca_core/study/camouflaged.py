"""Frames of a data set in camouflages, for a trainer of the user's own: composed by the exact light, as in an
optimization, not rendered again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ..attack import Renderer, load_paint
from ..contract import Dataset, Frame, Progress, RaucaError
from ..contract.color import to_bytes
from ..dataset_tools import export_dataset
from ..dataset_tools.export import Wearer
from .candidates import match, read_candidates, read_vehicle_choice

PLAIN = "plain"


def export_camouflaged(
    folder: Path,
    camouflages: Sequence[str],
    form: str,
    out: Path,
    progress: Callable[[Progress], None] = lambda _: None,
) -> int:
    """Export a data set in its own paint and in camouflages; see :func:`rauca_core.dataset_tools.export_dataset`.

    Args:
        camouflages: ``FILE`` or ``LABEL=FILE`` of each, JSON or PNG; labels name the images.

    Returns:
        how many targets were written, of all images.

    Raises:
        RaucaError: a data set without light maps, a camouflage of another vehicle, two of one label, and as of
            ``export_dataset``.
    """
    dataset = Dataset(Path(folder))
    if not dataset.plan.light:
        raise RaucaError(
            f"{folder}: made without light maps, which camouflages need; make it again in another folder by "
            "`rauca dataset make` without --no-light"
        )
    candidates = read_candidates(camouflages, (PLAIN,))
    match(
        candidates, [read_vehicle_choice(dataset.vehicle_folder)], True, f"`rauca optimize {folder}` makes one for it"
    )
    renderers = {size: Renderer(dataset, size) for size in {candidate.record.size for candidate in candidates}}
    worn = {candidate.label: wearer(renderers[candidate.record.size], candidate.path) for candidate in candidates}
    return export_dataset(dataset.folder, form, out, progress, worn)


def wearer(render: Renderer, camouflage: Path) -> Wearer:
    """What shows frames in a camouflage (JSON) of the renderer's size: 8-bit sRGB, None where the vehicle is hidden."""
    pixels = np.ascontiguousarray(load_paint(camouflage).texture.transpose(2, 0, 1))
    texture = torch.from_numpy(pixels).float() / 255
    shown = {frame.id for frame in render.frames}

    def wear(frame: Frame) -> NDArray[np.uint8] | None:
        if frame.id not in shown:
            return None
        images, _ = render(texture, [frame.id])
        return to_bytes(images[0].permute(1, 2, 0).numpy())

    return wear
