"""What stands for Blender in tests of studies: frames are drawn by numpy, and counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stability.drawn import around, draw_frame
from rauca_core.contract import (
    Dataset,
    Job,
    LedgerEntry,
    MakeDataset,
    Progress,
    RenderCamouflages,
    append_entry,
    claim_folder,
    load_camouflage,
    load_vehicle,
    save_frame,
)
from rauca_core.contract.clips import clip_name
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.runtime.images import read_image


class DrawnBlender:
    """Takes the jobs of the real one.

    Attributes:
        frames: how many were rendered, by job.
    """

    def __init__(self) -> None:
        self.frames: Counter[str] = Counter()

    def __call__(self, job: Job, progress: Callable[[Progress], None], blender: Path | None = None) -> None:
        assert isinstance(job, MakeDataset | RenderCamouflages)
        self._make(job) if isinstance(job, MakeDataset) else self._render(job)
        progress(Progress(1, 1, "drawn"))

    def _make(self, job: MakeDataset) -> None:
        vehicle = load_vehicle(Path(job.vehicle.name), read_image)
        plan = replace(job.plan, name=job.out.name, vehicle_name=vehicle.name, atlas_id=vehicle.atlas_id)
        if not (job.out / "vehicle").is_dir():
            vehicle.save(job.out / "vehicle")
        claim_folder(job.out, plan)
        for task in job.wanted():
            if not (job.out / "frames" / task.id).is_dir():
                azimuth = plan.ring.nominal(task.view)[0] if plan.clips is None else 10.0 * task.view
                frame, passes = draw_frame(vehicle, around(azimuth, plan.size), task.id, task.view, task.weather)
                frame = replace(frame, location=task.location)
                if plan.clips is not None:
                    clip = clip_name(plan.clips, task.location, task.view, task.weather.name)
                    time_s = plan.clips.at(task.view)[1]
                    gap_m = 20.0 - plan.clips.speed_m_s * time_s
                    frame = replace(frame, clip=clip, time_s=time_s, distance_m=gap_m)
                save_frame(job.out / "frames" / task.id, frame, passes)
                append_entry(job.out, LedgerEntry(task.id, "done"))
                self.frames["make_dataset"] += 1

    def _render(self, job: RenderCamouflages) -> None:
        dataset = Dataset(job.dataset)
        for path in job.camouflages:
            record, image = load_camouflage(path)
            color = read_image(image).reshape(-1, 3).mean(0)
            for frame in (frame for frame in dataset.frames() if frame.id in (job.frames or ())):
                target = job.out / record.name / f"{frame.id}.png"
                if not target.is_file():
                    pixels = read_image(dataset.frame_folder(frame.id) / "image.png").copy()
                    pixels[read_image(dataset.frame_folder(frame.id) / "paint.png") > 0] = color
                    write_bytes(target, png_bytes(np.ascontiguousarray(pixels)))
                    self.frames["render_camouflages"] += 1


@pytest.fixture
def drawn_blender(monkeypatch: pytest.MonkeyPatch) -> DrawnBlender:
    """In place of the real one, in this process."""
    drawn = DrawnBlender()
    monkeypatch.setattr("rauca_core.study.makers.run_blender", drawn)
    monkeypatch.setattr("rauca_core.study.makers.run_blenders", lambda jobs, *more: [drawn(job, *more) for job in jobs])
    return drawn
