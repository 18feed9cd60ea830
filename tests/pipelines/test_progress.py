"""How a job tells where it is and how long it still takes."""

from __future__ import annotations

import pytest

from blender_addon.jobs.messages import News, parse_news
from blender_addon.jobs.pace import REMEMBERED, Pace, spoken
from pipelines.console import console, progress_bar
from rauca_core.contract import Progress, parse_progress


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
    assert spoken(seconds) == words


def test_lines_survive_what_else_is_printed():
    news = News("failed", "L00-V000-day", reason='ValueError: "quoted", äöü')
    assert parse_news(news.line()) == news
    progress = Progress(3, 9, "L00-V000-day", 12.5)
    assert parse_progress(progress.line()) == progress
    assert parse_news("Fra:1 Mem:12M | Sample 1/8") is None
    assert parse_news(progress.line()) is None
    assert parse_progress(news.line()) is None


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
