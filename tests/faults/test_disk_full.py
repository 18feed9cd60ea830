"""A disk that fills up while a job works: one line that names it, nothing lost, and it goes on once there is room."""

from __future__ import annotations

from pathlib import Path

from tests.faults.jobs import JOBS, LEARNING, Begun, GoesOn, Inputs, Job, each
from tests.faults.running import Running, Surroundings, rauca
from tests.faults.small_disk import SmallDisk


@each(*JOBS)
def test_no_space_left(job: Job, inputs: Inputs, goes_on: GoesOn, disk: SmallDisk, tmp_path: Path) -> None:
    out, seen = disk.place / "out", disk.seen / "out"
    before = job.pulse(seen)
    running = Running(job.words(inputs, out), tmp_path / "log", disk.around)
    running.until(lambda: job.pulse(seen) != before)
    disk.fill()
    complaint = running.wait().complaint
    assert str(out) in complaint
    assert "no space left on the disk; free some" in complaint
    disk.free()
    assert not list(seen.rglob(".lock"))
    goes_on(job, out, disk.around, seen)


@each(*LEARNING)
def test_files_may_not_grow(job: Job, inputs: Inputs, begun: Begun, tmp_path: Path) -> None:
    """`ulimit -f` stands for every other limit of a disk; it needs no privilege."""
    out = begun(job, tmp_path / "out")
    complaint = rauca(job.words(inputs, out), tmp_path / "log", Surroundings(file_limit=3 << 10)).complaint
    assert str(out) in complaint
    assert "larger than files may be here" in complaint
    assert not list(out.rglob(".partial-*"))
