"""What users' own texts look like in a terminal: as they are, brackets and colons too."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rich.table import Table
from typer.testing import CliRunner

from pipelines.cli import app
from pipelines.console import console, output, progress_bar
from pipelines.doctor import Finding
from rauca_core.contract import Progress, RaucaError
from rauca_core.detect.catalogue import SOURCES
from rauca_core.detect.weights import Listed

ROOT = Path(__file__).resolve().parents[2]
ODD = "a[/b]x [old] :car: rauca[detectors]"


def test_texts_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    console.print(ODD)
    table = Table("what", title=ODD)
    table.add_row(ODD)
    output(200).print(table)
    told = capsys.readouterr()
    assert told.err.strip() == ODD
    assert told.out.count(ODD) == 2


def test_a_progress_bar_takes_any_title(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "_force_terminal", True)
    monkeypatch.setattr(console, "_width", 200)
    with console.capture() as told, progress_bar(f"hardening {ODD}") as move:
        move(Progress(1, 2, f"frame {ODD}"))
    assert f"hardening {ODD}" in told.get()
    assert f"frame {ODD}" in told.get()


def test_nothing_is_printed_past_it() -> None:
    """Of rich's own consoles each would read markup."""
    theirs = re.compile(r"from rich(\.console)? import .*(Console|print)|rich\.(print|get_console)|from_markup")
    sources = [p for room in ("pipelines", "benchmarks", "rauca_core") for p in (ROOT / room).rglob("*.py")]
    found = {p.relative_to(ROOT).as_posix() for p in sources if theirs.search(p.read_text())}
    assert found == {"pipelines/console.py"}


def test_remedies_can_be_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    source = next(iter(SOURCES.values()))
    remedy = "pip install 'rauca[detectors]'"
    monkeypatch.setattr("rauca_core.detect.weights.listing", lambda: [Listed(source, remedy, "")])
    assert f"{source.name}: {remedy}" in CliRunner().invoke(app, ["detectors", "list"]).stdout
    found = [Finding("numba", "missing", False, "pip install rauca[dataset]")]
    monkeypatch.setattr("pipelines.doctor.findings", lambda: found)
    assert found[0].remedy in CliRunner().invoke(app, ["doctor"]).stdout


def test_a_path_with_brackets_is_named_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "a[/b]x"
    told = CliRunner().invoke(app, ["weights", "fetch", "yolov3-tiny", "yolov4-tiny", "--from", str(folder)])
    assert isinstance(told.exception, RaucaError)
    assert str(folder) in told.stderr
