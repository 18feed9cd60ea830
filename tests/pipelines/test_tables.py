"""A report's table in a terminal: every value can be read, however narrow the terminal is."""

from __future__ import annotations

import re

import pytest

from pipelines.tables import print_table
from rauca_core.report.table import AVERAGE, Block, Cell, Column, Row, Table

NAMES = ("yolov3-tiny", "ssd-mobilenet-v2", "frcnn-synth", "yolox-nano")


def eleven_columns() -> Table:
    columns = (*(Column(f"{name}-{number}") for number in range(2) for name in NAMES), Column("took no part", AVERAGE))
    cells = tuple(Cell(place / 100, place / 200, min(1.0, place / 50)) for place in range(1, len(columns)))
    rows = (Row("normal", (*cells, None)), Row("a camouflage of some name", (*cells, Cell(0.5, 0.25, 0.75))))
    return Table("detectors", "AP", "Car AP@0.5 of the sedan.", columns, (Block("Seen weathers", rows),))


@pytest.mark.parametrize("width", [60, 80, 200])
def test_every_value_can_be_read(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    table = eleven_columns()
    print_table(table)
    said = capsys.readouterr().out
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= width
    for column in table.columns[:-1]:
        assert re.search(rf"\b{column.name}\b", said)
    values = re.findall(r"\d\.\d{3} \[\d\.\d{3}, \d\.\d{3}\]", said)
    assert len(values) == 2 * (len(table.columns) - 1) + 1
    assert values[-1] == "0.500 [0.250, 0.750]"
    assert said.count("Car AP@0.5 of the sedan. Seen weathers") == 1
