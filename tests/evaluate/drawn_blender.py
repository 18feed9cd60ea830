"""What stands for Blender in tests of studies: frames are drawn by numpy, and counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stability.drawn import around, draw_frame
from blender_addon.arguments import dataset_parser, render_parser
from blender_addon.selection import chosen_frames
from rauca_core.contract import (
    Dataset,
    LedgerEntry,
    Plan,
    Progress,
    Quality,
    Ring,
    append_entry,
    claim_folder,
    find_preset,
    load_camouflage,
    load_vehicle,
    planned_frames,
    save_frame,
)
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.runtime.images import read_image


class DrawnBlender:
    """Takes the arguments of the real one.

    Attributes:
        frames: how many were rendered, by job.
    """

    def __init__(self) -> None:
        self.frames: Counter[str] = Counter()

    def __call__(
        self, job: str, arguments: Sequence[str], progress: Callable[[Progress], None], blender: Path | None = None
    ) -> None:
        {"make_dataset": self._make, "render_camouflages": self._render}[job](arguments)
        progress(Progress(1, 1, "drawn"))

    def _make(self, arguments: Sequence[str]) -> None:
        given = dataset_parser().parse_args(arguments)
        vehicle = load_vehicle(Path(given.vehicle), read_image)
        ring = Ring(
            given.azimuths, given.elevations, given.distances, given.jitter_azimuth, given.jitter_elevation,
            given.jitter_distance, given.jitter_aim, given.jitter_roll, given.fov,
        )  # fmt: skip
        quality = Quality(given.samples, given.adaptive_threshold, given.denoise, given.bounces, given.composed_fog)
        plan = Plan(
            given.out.name, vehicle.name, vehicle.atlas_id, given.size, quality, given.light,
            tuple(find_preset(given.weathers, Path())), ring, given.locations, given.reference, given.min_visible,
            given.seed, "none", finish=given.finish, recolor_share=given.recolor_share,
        )  # fmt: skip
        if not (given.out / "vehicle").is_dir():
            vehicle.save(given.out / "vehicle")
        claim_folder(given.out, plan)
        chosen = chosen_frames(plan, given)
        for task in planned_frames(plan):
            if task.id in chosen and not (given.out / "frames" / task.id).is_dir():
                camera = around(plan.ring.nominal(task.view)[0], plan.size)
                drawn = draw_frame(vehicle, camera, task.id, task.view, task.weather)
                save_frame(given.out / "frames" / task.id, *drawn)
                append_entry(given.out, LedgerEntry(task.id, "done"))
                self.frames["make_dataset"] += 1

    def _render(self, arguments: Sequence[str]) -> None:
        given = render_parser().parse_args(arguments)
        wanted = set(given.only.read_text().split())
        dataset = Dataset(given.dataset)
        for path in given.camouflages:
            record, image = load_camouflage(path)
            color = read_image(image).reshape(-1, 3).mean(0)
            for frame in (frame for frame in dataset.frames() if frame.id in wanted):
                target = given.out / record.name / f"{frame.id}.png"
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
    return drawn
