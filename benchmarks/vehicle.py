"""Do detectors take the plain vehicle for a car, from every side? Car scores around a ring.

``rauca bench vehicle`` runs it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from rich.table import Table

from pipelines.console import output, progress_bar
from rauca_core.contract import Dataset, RaucaError
from rauca_core.contract.files import write_json
from rauca_core.detect import car_score, load_detector
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.images import read_image

RING = (
    "--weathers single --azimuths 8 --elevations 12 --distances 6.5 --size 416 --samples 8 --no-light --min-visible 0"
)


def bench_vehicle(vehicle: Sequence[str], detectors: Sequence[str], out: Path) -> dict[str, list[float]]:
    """Render the vehicle in grey at 416 x 416 from eight sides; the best car score of each detector in each view.

    Args:
        vehicle: arguments of ``rauca dataset make`` that choose it.
        out: JSON to write.
    """
    loaded = {name: load_detector(name) for name in detectors}  # a wrong name is told before anything is rendered
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary) / "ring"
        with progress_bar("rendering the ring", resumes=False) as move:
            run_blender("make_dataset", ["--out", str(folder), *vehicle, *RING.split(), "--json-progress"], move)
        dataset = Dataset(folder)
        frames = dataset.frames()
        if any(frame.box_xyxy is None for frame in frames):
            raise RaucaError("the vehicle is not in every view of the ring; check its size, in metres, and its origin")
        pixels = np.stack([read_image(dataset.frame_folder(f.id) / "image.png") for f in frames])
    images = torch.from_numpy(pixels).permute(0, 3, 1, 2).float() / 255
    boxes = torch.tensor([f.box_xyxy for f in frames], dtype=torch.float32)
    scores = {name: car_score(detector, images, boxes).tolist() for name, detector in loaded.items()}
    azimuths = [f.azimuth_deg for f in frames]
    table = Table("detector", *(f"{a:.0f}°" for a in azimuths), "mean", title="car score (azimuth 0: front)")
    for name, row in scores.items():
        table.add_row(name, *(f"{s:.2f}" for s in row), f"{np.mean(row):.3f}")
    output().print(table)
    write_json(out, {"azimuths_deg": azimuths, "scores": scores})
    return scores
