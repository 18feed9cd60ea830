"""A folder that cannot be written to: one line that names it, nothing in it changes; data sets need not be writable."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.faults.jobs import JOBS, LEARNING, Begun, GoesOn, Inputs, Job, each, files
from tests.faults.running import rauca
from tests.faults.small_disk import SmallDisk


@each(*JOBS)
def test_read_only_folder(job: Job, inputs: Inputs, begun: Begun, disk: SmallDisk, tmp_path: Path) -> None:
    begun(job, disk.seen / "out")
    before = files(disk.seen, "**/*")
    disk.remount("ro")
    complaint = rauca(job.words(inputs, disk.place / "out"), tmp_path / "log", disk.around).complaint
    assert str(disk.place / "out") in complaint
    assert "not writable; choose another output folder" in complaint
    assert files(disk.seen, "**/*") == before


@each(*LEARNING)
def test_read_only_data_set(job: Job, inputs: Inputs, goes_on: GoesOn, disk: SmallDisk, tmp_path: Path) -> None:
    shutil.copytree(inputs.data, disk.seen / "data", ignore=shutil.ignore_patterns("taps"))
    disk.remount("ro")
    goes_on(job, tmp_path / "out", disk.around, data=disk.place / "data")
