"""The page on commands is what the commands themselves say."""

from __future__ import annotations

from pathlib import Path

from pipelines.cli import COMMANDS, GROUPS, app
from tools.command_reference import BEGIN, END, reference

PAGE = Path(__file__).resolve().parents[2] / "docs" / "commands.md"


def test_the_page_is_renewed() -> None:
    between = PAGE.read_text().partition(BEGIN)[2].partition(END)[0]
    assert between.strip() == reference().strip(), "run `python tools/command_reference.py docs/commands.md`"


def test_every_command_stands_below_a_heading_of_the_help() -> None:
    assert all(command.rich_help_panel for command in app.registered_commands)
    assert all(group.rich_help_panel for group in app.registered_groups)
    assert len(COMMANDS) + len({heading for _, heading in GROUPS.values()}) >= 6
