"""Jobs beside the window, without Blender: real child processes, their ends in words, their pictures."""

from __future__ import annotations

import io
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from blender_addon.jobs.background import Job, JobUpdate, Task
from blender_addon.jobs.child import IN_THE_WINDOW, ending
from blender_addon.jobs.thumbnails import COLOR, MARGIN, SIDE, curve, thumbnail
from blender_addon.steps.optimize import earlier
from rauca_core.contract import Progress, RaucaError, parse_progress
from rauca_core.contract.files import png_bytes
from tests.blender import timer

REPOSITORY = Path(__file__).resolve().parent.parent.parent

# Counts to five in a file, a number at a time; asked to stop, it ends after the number in hand.
COUNTING = """
import pathlib, signal, sys, time
sys.path.insert(0, ROOT)
from rauca_core.contract import Progress
stopping = []
signal.signal(signal.SIGTERM, lambda *_: stopping.append(1))
counted = pathlib.Path(FILE)
while (n := int(counted.read_text())) < 5 and not stopping:
    time.sleep(0.05)
    counted.write_text(str(n + 1))
    print(Progress(n + 1, 5, "").line(), flush=True)
sys.exit(0 if n >= 5 else 2)
"""


@dataclass
class Script(Task):
    """A task that runs a piece of Python, ``start``."""

    cleaned: int = 0
    starts: int = 0

    def command(self) -> list[str]:
        self.starts += 1
        return [sys.executable, "-c", self.start]

    def hear(self, line: str) -> JobUpdate | None:
        progress = parse_progress(line)
        return JobUpdate(progress.done, progress.total, progress.left_s) if progress else JobUpdate(note=line)

    def clean(self) -> None:
        self.cleaned += 1


def until(job: Job, reached, seconds: float = 60.0) -> None:
    """Tick until ``reached``, as Blender's timer does."""
    timer.until(reached, seconds, job.tick)


def ended(code: str, folder: Path) -> Job:
    job = Job(Script(folder, code))
    until(job, lambda: not job.alive)
    return job


def counting(folder: Path) -> Script:
    file = folder / "count"
    file.write_text("0")
    return Script(folder, f"ROOT, FILE = {str(REPOSITORY)!r}, {str(file)!r}\n{COUNTING}")


def test_a_paused_job_goes_on_where_it_was(tmp_path):
    job = Job(counting(tmp_path))
    until(job, lambda: job.done >= 1)
    job.pause()
    assert job.phase == "pausing"
    until(job, lambda: job.phase == "paused")
    stood = (tmp_path / "count").read_text()
    assert 1 <= int(stood) < 5
    assert job.alive
    assert not job.tick()
    assert (tmp_path / "count").read_text() == stood
    job.go_on()
    until(job, lambda: not job.alive)
    assert (job.phase, job.done, job.fraction) == ("done", 5, 1.0)
    assert (job.task.starts, job.task.cleaned) == (2, 1)


def test_stopping_keeps_what_is_finished_and_a_paused_job_stops_too(tmp_path):
    job = Job(counting(tmp_path))
    until(job, lambda: job.done >= 1)
    job.stop()
    until(job, lambda: not job.alive)
    assert job.phase == "stopped"
    assert "Start again" in job.ending
    again = Job(job.task)
    until(again, lambda: again.done >= 1 or not again.alive)
    again.pause()
    until(again, lambda: again.phase in ("paused", "done"))
    again.stop()
    assert not again.alive


def test_stopping_twice_does_not_wait_for_a_child_that_goes_on(tmp_path):
    stubborn = "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('up', flush=True)\n"
    job = Job(Script(tmp_path, stubborn + "time.sleep(600)"))
    until(job, lambda: job.notes == ["up"])
    job.stop()
    for _ in range(20):
        job.tick()
        time.sleep(0.01)
    assert job.phase == "stopping"
    job.stop()
    until(job, lambda: not job.alive)
    assert job.phase == "stopped"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "killed, perhaps for want of memory"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
        ("import sys; print('it hurts', file=sys.stderr); sys.exit(7)", "code 7: it hurts"),
        ("import sys; sys.exit(7)", "code 7: no message"),
        ("import sys; print('error: x: no space; run the same command again\\nbye', file=sys.stderr); sys.exit(2)",
         "X: no space; start again"),
        ("import sys; print('interrupted: y', file=sys.stderr); sys.exit(2)", "interrupted from outside"),
    ],
)  # fmt: skip
def test_an_end_nobody_asked_for_is_told_in_words(tmp_path, code, words):
    job = ended(code, tmp_path)
    assert job.phase == "failed"
    assert words in job.ending
    assert job.task.cleaned == 1


def test_a_program_that_is_not_there_is_refused(tmp_path):
    task = Script(tmp_path, "")
    task.command = lambda: [str(tmp_path / "none")]
    with pytest.raises(RaucaError, match="cannot be started"):
        Job(task)
    assert task.cleaned == 1


def test_a_flood_of_lines_is_heard_whole_and_little_by_little(tmp_path):
    line = Progress(1, 50_000, "a" * 40).line()
    code = f"for i in range(50_000): print({line!r}.replace('\"done\": 1', '\"done\": ' + str(i + 1)))"
    job, longest = Job(Script(tmp_path, code)), 0.0
    while job.alive:
        begin = time.thread_time()
        job.tick()
        longest = max(longest, time.thread_time() - begin)
        time.sleep(0.001)
    assert job.done == 50_000
    assert longest < 0.1  # of this thread's own time, whatever else the machine does


def test_what_the_command_line_says_is_still_said_there():
    sources = [
        path for room in ("blender_addon", "rauca_core", "pipelines") for path in (REPOSITORY / room).rglob("*.py")
    ]
    text = "".join(p.read_text() for p in sources if p.name != "child.py").replace('"\n            "', "")
    for there, here in IN_THE_WINDOW:
        assert there in text, there
        assert "--" not in here
    said = ending(2, ["error: a: not writable; choose another output folder"])
    assert said == "A: not writable; choose another folder"


def test_a_thumbnail_is_the_mean_of_its_blocks(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (2 * SIDE, 3 * SIDE, 3), np.uint8)
    (tmp_path / "a.png").write_bytes(png_bytes(pixels))
    small = thumbnail(tmp_path / "a.png")
    shrunk = np.asarray(Image.open(tmp_path / "a.png").reduce(3), np.int16)
    assert small.shape == (2 * SIDE // 3, SIDE, 3)
    assert np.abs(small - shrunk[: small.shape[0]]).max() <= 1
    (tmp_path / "b.png").write_bytes(png_bytes(pixels[:7, :5]))
    assert np.array_equal(thumbnail(tmp_path / "b.png"), pixels[:7, :5])
    (tmp_path / "c.png").write_bytes(png_bytes(pixels[:7, :5, 0]))
    assert np.array_equal(thumbnail(tmp_path / "c.png")[..., 2], pixels[:7, :5, 0])


def test_no_thumbnail_of_what_rauca_did_not_write(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (40, 40, 3), np.uint8)
    ours, path = png_bytes(pixels), tmp_path / "a.png"
    foreign = io.BytesIO()
    Image.fromarray(np.tile(np.arange(64, dtype=np.uint8), (64, 1))).save(foreign, "PNG")
    for data in (b"", b"GIF89a", ours[:100], ours[:20], ours[:8], foreign.getvalue()):
        path.write_bytes(data)
        assert thumbnail(path) is None, data[:20]
    assert thumbnail(tmp_path / "none.png") is None


def test_the_curve_begins_with_the_whole_lines_of_an_earlier_run(tmp_path):
    assert earlier(tmp_path, 9) == []
    whole = [f'{{"step": {n}, "loss": {0.1 * n:.1f}, "score": 0.5, "seconds": 1}}' for n in (1, 2, 3)]
    damaged = ["[" * 100_000, "3", '{"step": "one"}', '{"step": 1, "loss": NaN, "score": 0.5}', '{"step": 1, "lo']
    (tmp_path / "history.jsonl").write_text("\n".join([*whole, *damaged]))
    assert earlier(tmp_path, 3) == [{"loss": 0.1, "score": 0.5}, {"loss": 0.2, "score": 0.5}]


def test_the_curve_goes_where_the_values_go():
    falling = curve(np.linspace(9.0, -1.0, 1000).tolist())
    ink = falling[..., 3] > 0.99
    tops = ink.argmax(0)[MARGIN:-MARGIN]
    assert abs(tops[0] - MARGIN) <= 2
    assert abs(tops[-1] - (len(falling) - 1 - MARGIN)) <= 2
    assert (np.diff(tops) >= 0).all()
    assert np.allclose(falling[ink][:, :3], COLOR, atol=0.02)
    assert (falling[..., :3] <= falling[..., 3:] + 1e-6).all()  # premultiplied, or its faint area shines
    assert not falling[:, :MARGIN].any()
    assert not falling[:, -MARGIN:].any()
    steep = curve([0.0, 1.0] * 20)[..., 3] > 0.99  # drawn without gaps however steep
    assert steep[MARGIN:-MARGIN, MARGIN:-MARGIN].any(1).all()


@pytest.mark.parametrize("values", [[], [1.0], [float("nan"), 2.0], [3.0, 3.0, 3.0], [1.0, float("inf"), 2.0]])
def test_the_curve_of_hard_cases_is_a_picture(values):
    picture = curve(values)
    assert np.isfinite(picture).all()
    finite = [v for v in values if np.isfinite(v)]
    assert (picture[..., 3] > 0.99).any() == (len(finite) > 1)
