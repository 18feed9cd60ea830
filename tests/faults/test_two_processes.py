"""Two processes on one folder: the second is told who is at work there, the first is not disturbed.

Data sets may be shared by processes that render other cameras: tests/pipelines/test_jobs.py has theirs.
"""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import pytest

from rauca_core.contract import RaucaError
from rauca_core.runtime.folder_lock import LOCK_FILE, alone_in
from tests.faults.jobs import LEARNING, Begun, Inputs, Job, Whole, each
from tests.faults.running import Running, rauca


@each(*LEARNING)
def test_second_process(job: Job, inputs: Inputs, whole: Whole, begun: Begun, tmp_path: Path) -> None:
    out = begun(job, tmp_path / "out")
    before = job.pulse(out)
    first = Running(job.words(inputs, out), tmp_path / "log")
    first.until(lambda: job.pulse(out) != before).signal(signal.SIGSTOP)
    complaint = rauca(job.words(inputs, out), tmp_path / "log of the second").complaint
    assert f"{out}: process {first.pid} on {socket.gethostname()} is at work here" in complaint
    first.signal(signal.SIGCONT)
    ended = first.wait()
    assert ended.code == 0, ended.said
    assert job.content(out) == whole(job)
    assert not (out / LOCK_FILE).exists()


def test_a_lock_leaves_nothing_behind(tmp_path: Path) -> None:
    with alone_in(tmp_path / "new" / "folder"):
        assert (tmp_path / "new" / "folder" / LOCK_FILE).is_file()
    assert not (tmp_path / "new" / "folder").exists()
    (tmp_path / "kept").touch()
    with pytest.raises(ZeroDivisionError), alone_in(tmp_path):
        _ = 1 / 0
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["kept"]


def child_in(folder: Path) -> int:
    """The number of a process that holds ``folder`` until it is killed."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        with alone_in(folder):
            os.write(write, b".")
            signal.pause()
    os.read(read, 1)
    return child


def test_a_lock_dies_with_its_holder(tmp_path: Path) -> None:
    child = child_in(tmp_path)
    with pytest.raises(RaucaError, match=f"process {child} on .* is at work here; wait for it"), alone_in(tmp_path):
        pass
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert (tmp_path / LOCK_FILE).is_file()
    with alone_in(tmp_path):
        pass
    assert not (tmp_path / LOCK_FILE).exists()


def test_a_lock_that_leads_elsewhere_is_refused(tmp_path: Path) -> None:
    mine, folder = tmp_path / "mine", tmp_path / "run"
    mine.write_text("precious")
    folder.mkdir()
    (folder / LOCK_FILE).symlink_to(mine)
    with pytest.raises(RaucaError, match="is no file of this folder"), alone_in(folder):
        pass
    assert mine.read_text() == "precious"


@pytest.mark.parametrize(
    "note", [b"", b"[" * 4096, b"3", b'{"pid": "x", "host": "y"}', b'{"pid": 1, "host": "a\\u001b"}']
)
def test_a_damaged_note_names_nobody(tmp_path: Path, note: bytes) -> None:
    child = child_in(tmp_path)
    (tmp_path / LOCK_FILE).write_bytes(note)
    try:
        with pytest.raises(RaucaError, match=": another process is at work here"), alone_in(tmp_path):
            pass
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
