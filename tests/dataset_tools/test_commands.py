"""`rauca dataset check|view|export|recolor` as typed."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import RaucaError


def rauca(*arguments: object):
    return CliRunner().invoke(app, ["dataset", *map(str, arguments)])


def test_check_tells_by_exit_code_table_and_json(mini, tmp_path):
    whole = rauca("check", mini.folder, "--json", tmp_path / "check.json")
    assert whole.exit_code == 0, whole.output
    assert "dusk" in whole.output
    assert "whole" in whole.output
    report = json.loads((tmp_path / "check.json").read_text())
    assert report["findings"] == []
    assert report["weathers"]["day"]["done"] == 2

    victim = mini.frame_folder(mini.frames()[0].id) / "passes.npz"
    victim.write_bytes(victim.read_bytes()[:-1])
    broken = rauca("check", mini.folder)
    assert broken.exit_code == 2
    lines = [line for line in broken.stdout.splitlines() if line.startswith("frames/")]
    assert len(lines) == 1
    assert "passes.npz: its bytes are not those that were written" in lines[0]
    assert "check with --remove-damaged and run" in lines[0]


def test_check_accepts_an_unfinished_set_only_when_told(mini):
    frame = mini.frames()[0]
    for path in [*mini.frame_folder(frame.id).iterdir()]:
        path.unlink()
    mini.frame_folder(frame.id).rmdir()
    ledger = mini.folder / "ledger.jsonl"
    ledger.write_text("".join(line for line in ledger.open() if frame.id not in line))
    assert rauca("check", mini.folder).exit_code == 2
    assert rauca("check", mini.folder, "--unfinished").exit_code == 0


def test_view_export_and_recolor_write_what_they_say(mini, tmp_path):
    assert rauca("view", mini.folder, "--out", tmp_path / "view").exit_code == 0
    assert (tmp_path / "view" / "index.html").is_file()
    assert rauca("export", mini.folder, "--format", "yolo", "--out", tmp_path / "yolo").exit_code == 0
    assert len(list((tmp_path / "yolo" / "labels").iterdir())) == 4
    assert rauca("recolor", mini.folder, "--colors", "ff0000,00ff00", "--out", tmp_path / "red").exit_code == 0
    assert sorted(p.name for p in (tmp_path / "red").iterdir()) == ["00ff00", "ff0000"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check"], "not a data set"),
        (["recolor", "--colors", "red", "--out", "x"], "colors 'red': give train, test, or"),
        (["export", "--format", "voc", "--out", "x"], "format 'voc' is unknown"),
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, arguments, message):
    result = rauca(arguments[0], tmp_path / "nothing", *arguments[1:])
    assert isinstance(result.exception, RaucaError)
    assert message in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not list(tmp_path.iterdir())
