"""The table of faults in docs/reliability.md names tests that are there, and every test that is there."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
PAGE = TESTS.parent / "docs" / "reliability.md"
HERE = Path(__file__).parent


def named(text: str) -> list[tuple[str, str, str]]:
    """File below tests/, function and parameter ("" for none) of every test that a text names."""
    found = re.findall(r"`([\w/]+\.py)::(\w+)(?:\[([\w-]+)\])?`", text)
    return [(file if "/" in file else f"faults/{file}", test, parameter) for file, test, parameter in found]


def in_file(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def parameters_of(file: str, test: str) -> set[str]:
    """What a test of this folder is run for."""
    function = getattr(importlib.import_module(f"tests.{file[:-3].replace('/', '.')}"), test)
    marks = [mark for mark in getattr(function, "pytestmark", ()) if mark.name == "parametrize"]
    ids = [mark.kwargs.get("ids") or [value.id for value in mark.args[1]] for mark in marks]
    return set().union(*ids) if ids else set()


def table() -> list[list[str]]:
    _, _, after = PAGE.read_text(encoding="utf-8").partition("<!-- faults: ")
    rows = [line for line in after.partition("<!-- end of faults -->")[0].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_every_test_of_the_page_exists() -> None:
    tests = named(PAGE.read_text(encoding="utf-8"))
    assert len(tests) > 40
    for file, test, parameter in tests:
        assert test in in_file(TESTS / file), f"{file}::{test}"
        assert not parameter or parameter in parameters_of(file, test), f"{file}::{test}[{parameter}]"


def test_every_fault_has_a_test_for_every_job_or_a_reason() -> None:
    head, _, *rows = table()
    assert len(head) == 5
    assert len(rows) > 8
    for fault, *cells in rows:
        assert len(cells) == 4, fault
        assert all(cells), fault
        assert sum(bool(named(cell)) for cell in cells) >= 2, fault
        for column, cell in zip(head[1:], cells, strict=True):
            job = column.strip("`").removeprefix("rauca ").replace(" ", "-")
            assert {parameter for _, _, parameter in named(cell)} <= {"", job}, f"{fault}, {column}"


def test_every_test_of_this_folder_is_in_the_table() -> None:
    told = {(file, test) for file, test, _ in named(PAGE.read_text(encoding="utf-8"))}
    of_their_tools = {
        "test_a_lock_leaves_nothing_behind",
        "test_a_lock_dies_with_its_holder",
        "test_a_lock_that_leads_elsewhere_is_refused",
        "test_a_damaged_note_names_nobody",
        "test_the_clock_does_jump",
    }
    for path in HERE.glob("test_*.py"):
        if path != Path(__file__):
            assert {("faults/" + path.name, test) for test in in_file(path) - of_their_tools} <= told
