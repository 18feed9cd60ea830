"""How a job tells where it is and how long it still takes."""

from __future__ import annotations

import re
import sys
import threading
from typing import Any, NoReturn

import pytest
from typer.testing import CliRunner

from blender_addon.jobs.supervisor import REMEMBERED, Crew, Listener, Pace, Supervisor
from blender_addon.jobs.workers import News, parse_news
from pipelines import dataset_commands
from pipelines.cli import app
from pipelines.console import console, progress_bar
from rauca_core.contract import Progress, RaucaError, Shard, format_duration, parse_progress


def test_the_estimate_follows_the_latest_frames():
    now = [0.0]
    pace = Pace(lambda: now[0])
    assert pace.left_s(10) is None
    for _ in range(REMEMBERED):
        now[0] += 5.0
        pace.step()
    assert pace.left_s(10) == pytest.approx(50)
    for _ in range(REMEMBERED):  # the weather changes, frames get slower
        now[0] += 20.0
        pace.step()
    assert pace.left_s(10) == pytest.approx(200)
    assert pace.left_s(0) == 0


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.2, "0 s"), (89, "89 s"), (91, "2 min"), (3540, "59 min"), (12030, "3 h 20 min")]
)
def test_durations_are_spoken(seconds, words):
    assert format_duration(seconds) == words


def test_lines_survive_what_else_is_printed():
    news = News("failed", "L00-V000-day", reason='ValueError: "quoted", äöü')
    assert parse_news(news.line()) == news
    progress = Progress(3, 9, "L00-V000-day", 12.5)
    assert parse_news("Fra:1 Mem:12M | Sample 1/8") is None
    assert parse_news(progress.line()) is None
    assert parse_progress(news.line()) is None


@pytest.mark.parametrize("rest", ['{"event"', "[]", '{"event": "done", "what": 1}', ""])
def test_a_damaged_line_of_a_worker_is_an_error(rest):
    with pytest.raises(RaucaError, match="which is no news of a worker"):
        parse_news(f"rauca-worker {rest}\n")


def test_a_worker_that_talks_nonsense_is_replaced_and_then_given_up(tmp_path):
    """In a thread: a supervisor that waits for ever fails the test, and does not stop the others."""
    code = "import sys; print('rauca-worker {\"event', flush=True); sys.stdin.read()"
    listener = Listener(lambda progress: None, lambda note: None)
    supervisor = Supervisor(tmp_path, Shard(), Crew([sys.executable, "-c", code]), listener, lambda: None)
    told: list[str] = []

    def run() -> None:
        try:
            supervisor.run([["L00-V000-day"]], 0)
        except RaucaError as error:
            told.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(timeout=60)
    (reason,) = told
    assert reason.startswith("3 workers died before their first frame: Blender said 'rauca-worker ")
    assert reason.endswith("which is no news of a worker")
    assert not list(tmp_path.iterdir())


def test_progress_for_programs_is_on_standard_output_and_for_people_beside_it(monkeypatch, tmp_path):
    told = [Progress(i, 2, f"L00-V00{i}-day") for i in range(3)]
    monkeypatch.setattr(dataset_commands, "run_blender", lambda job, move, blender: [*map(move, told)])
    for asked, expected in ([], []), (["--json-progress"], told):
        done = CliRunner().invoke(app, ["dataset", "make", "--out", str(tmp_path / "set"), *asked])
        assert done.exit_code == 0, done.output
        assert [parse_progress(line) for line in done.stdout.splitlines()] == expected


@pytest.mark.parametrize(("resumes", "told"), [(True, "run the same command again"), (False, "nothing was kept")])
def test_an_interruption_promises_no_more_than_is_kept(resumes, told):
    with pytest.raises(RaucaError, match=told), progress_bar("measuring", resumes=resumes):
        raise KeyboardInterrupt


def stopped(*_: Any, **__: Any) -> NoReturn:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("work", "command", "told"),
    [
        ("run_blender", ("make", "--out", "set"), "is kept; run the same command again to go on"),
        ("recolor_dataset", ("recolor", "set", "--out", "x"), "is kept; run the same command again to go on"),
        ("check_dataset", ("check", "set"), "nothing was kept"),
    ],
)
def test_an_interrupted_command_says_how_to_go_on(monkeypatch, tmp_path, work, command, told):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(dataset_commands, work, stopped)
    done = CliRunner().invoke(app, ["dataset", *command])
    assert isinstance(done.exception, RaucaError)
    assert str(done.exception).endswith(told)


def test_a_log_gets_a_line_per_frame():
    with console.capture() as captured, progress_bar("rendering", every_step=True) as move:
        move(Progress(1, 2, "L00-V000-day", 600.0))
        move(Progress(2, 2, "L00-V001-day", 0.0))
    assert captured.get().splitlines() == [
        "rendering ...",
        "[1/2] L00-V000-day, about 10 min left",
        "[2/2] L00-V001-day, about 0 s left",
        "rendering: 2 of 2",
    ]


@pytest.mark.parametrize(("silent_s", "lines"), [(0.0, 2), (60.0, 0)])
def test_a_log_of_long_work_is_not_left_without_a_line(monkeypatch, silent_s, lines):
    monkeypatch.setattr("pipelines.console.SILENT_S", silent_s)
    with console.capture() as captured, progress_bar("optimizing") as move:
        move(Progress(1, 3, "loss 2.1"))
        move(Progress(2, 3, "loss 1.9"))
    first, *between, last = captured.get().splitlines()
    assert (first, last) == ("optimizing ...", "optimizing: 2 of 3")
    assert len(between) == lines
    assert not between or re.fullmatch(r"\[2/3\] loss 1\.9, about .+ left", between[1])
