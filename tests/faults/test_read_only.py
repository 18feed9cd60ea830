"""A folder that cannot be written to: one line that names it, nothing in it changes; data sets need not be writable."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tests.faults.jobs import JOBS, LEARNING, Content, Inputs, Job, each, files
from tests.faults.running import rauca
from tests.faults.small_disk import SmallDisk

Whole, Begun = Callable[[Job], Content], Callable[[Job, Path], Path]


@each(*JOBS)
def test_read_only_folder(job: Job, inputs: Inputs, begun: Begun, disk: SmallDisk, tmp_path: Path) -> None:
    begun(job, disk.seen / "out")
    before = files(disk.seen, "**/*")
    words = job.words(inputs, disk.seen / "out")
    words[words.index(str(disk.seen / "out"))] = str(disk.place / "out")
    disk.remount("ro")
    complaint = rauca(words, tmp_path / "log", disk.around).complaint
    assert str(disk.place / "out") in complaint
    assert "not writable; choose another output folder" in complaint
    assert files(disk.seen, "**/*") == before


@each(*LEARNING)
def test_read_only_data_set(job: Job, inputs: Inputs, whole: Whole, disk: SmallDisk, tmp_path: Path) -> None:
    shutil.copytree(inputs.data, disk.seen / "data", ignore=shutil.ignore_patterns("taps"))
    disk.remount("ro")
    ended = rauca(job.words(replace(inputs, data=disk.place / "data"), tmp_path / "out"), tmp_path / "log", disk.around)
    assert ended.code == 0, ended.said
    assert job.content(tmp_path / "out") == whole(job)
