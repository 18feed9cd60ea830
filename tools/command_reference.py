"""The page on every command, written from the commands themselves.

``python tools/command_reference.py docs/commands.md`` renews what stands between the page's marks.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import typer

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.harness import fill_between  # noqa: E402
from pipelines.cli import app  # noqa: E402
from pipelines.dataset_options import dataset_parser  # noqa: E402
from rauca_core.contract import RaucaError  # noqa: E402

BEGIN, END = "<!-- commands: written by tools/command_reference.py -->", "<!-- end of commands -->"


def reference() -> str:
    """Every command with its arguments and options, as Markdown."""
    root: Any = typer.main.get_command(app)
    return "\n".join(line for name, command in _leaves(root, "rauca") for line in _section(name, command))


def _leaves(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Commands that do something, in alphabetical order, by their full name."""
    if not hasattr(command, "commands"):
        yield name, command
        return
    for word, inner in sorted(command.commands.items()):
        yield from _leaves(inner, f"{name} {word}")


def _section(name: str, command: Any) -> Iterator[str]:
    told = (command.help or "").split("\n\n")[0].replace("\n", " ")
    yield f"### {name}\n\n{told}\n"
    rows = list(_dataset_rows() if name == "rauca dataset make" else _rows(command))
    if rows:
        yield "| option | what it is | default |\n|---|---|---|"
        yield "\n".join(f"| {' | '.join(map(_cell, row))} |" for row in rows) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _rows(command: Any) -> Iterator[tuple[str, str, str]]:
    """Of its arguments and options, in the order and under the headings of its help."""
    panels: dict[str, list[Any]] = {"": []}
    for one in command.params:
        panels.setdefault(getattr(one, "rich_help_panel", None) or "", []).append(one)
    for title, inside in panels.items():
        if title:
            yield f"*{title}*", "", ""
        yield from _told(inside)


def _told(params: Iterable[Any]) -> Iterator[tuple[str, str, str]]:
    for one in params:
        if one.param_type_name == "argument":
            names = (one.metavar or one.name).upper()
        else:
            names = ", ".join(f"`{word}`" for word in [*one.opts, *one.secondary_opts])
        shown = "required" if one.required else _default(one.default)
        yield names, " ".join((getattr(one, "help", "") or "").split()), shown


def _dataset_rows() -> Iterator[tuple[str, str, str]]:
    """Of the command whose options Blender's own Python reads, too, without typer."""
    for one in dataset_parser()._actions:  # argparse tells of its options nowhere else
        if one.option_strings and "--help" not in one.option_strings:
            shown = "required" if one.required else _default(one.default)
            yield ", ".join(f"`{word}`" for word in one.option_strings), " ".join((one.help or "").split()), shown


def _default(value: Any) -> str:
    if callable(value) or value is None or value is False or value == "":
        return ""
    if isinstance(value, list | tuple):
        return ", ".join(f"{one:g}" if isinstance(one, float) else str(one) for one in value)
    return "yes" if value is True else str(value)


if __name__ == "__main__":
    try:
        fill_between(Path(sys.argv[1]), BEGIN, END, reference())
    except RaucaError as error:
        sys.exit(f"error: {error}")
