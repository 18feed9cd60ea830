"""JSON and files of JSON lines: complaints name file and field, whole lines are read whatever lies between them."""

import json

import pytest

from rauca_core.contract import LedgerEntry, RaucaError, append_entry, read_ledger
from rauca_core.contract.files import append_line
from rauca_core.contract.schema import Fields, read_json, whole_lines
from rauca_core.dataset_tools.check import check_ledgers


@pytest.mark.parametrize(
    ("getter", "value", "message"),
    [
        (lambda f: f.number("x"), "1", "f: x must be a finite number, not '1'"),
        (lambda f: f.number("x"), True, "finite number"),
        (lambda f: f.number("x", 0, 1), 2, "between 0 and 1"),
        (lambda f: f.number("x"), float("nan"), "finite number"),
        (lambda f: f.integer("x"), 1.5, "whole number"),
        (lambda f: f.text("x"), 3, "text"),
        (lambda f: f.flag("x"), 1, "true or false"),
        (lambda f: f.file_name("x"), "../../etc/passwd", "relative path inside"),
        (lambda f: f.file_name("x"), "/etc/passwd", "relative path inside"),
        (lambda f: f.file_name("x"), "a\\..\\b", "relative path inside"),
        (lambda f: f.array("x", (2, 2)), [[1, 2], [3]], "2x2 finite numbers"),
        (lambda f: f.array("x", (2,)), [1, None], "2 finite numbers"),
        (lambda f: f.items("x"), {}, "a list"),
        (lambda f: f.nested("x"), [], "JSON object"),
    ],
)
def test_every_complaint_names_file_and_field(getter, value, message):
    with pytest.raises(RaucaError, match=r"^f: ") as caught:
        getter(Fields({"x": value}, "f"))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_unknown_fields():
    fields = Fields({"typo": 1}, "a.json")
    with pytest.raises(RaucaError, match=r"a\.json: field width is missing"):
        fields.integer("width")
    with pytest.raises(RaucaError, match=r"a\.json: unknown field typo"):
        fields.done()


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"[1]"])
def test_damaged_json_is_named(tmp_path, content):
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(RaucaError, match=r"a\.json"):
        read_json(path)


def test_newer_version_asks_for_an_update(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"format": "rauca-dataset", "version": 99}))
    with pytest.raises(RaucaError, match=r"version 99.*update rauca"):
        read_json(path).format("rauca-dataset", 1)
    with pytest.raises(RaucaError, match="this is a rauca-dataset file, a rauca-frame file was expected"):
        read_json(path).format("rauca-frame", 1)
    path.write_text("{}")
    with pytest.raises(RaucaError, match=r"a\.json: no rauca-frame file, its field `format` is missing"):
        read_json(path).format("rauca-frame", 1)


DAMAGED = (
    '{"step": 2',
    "[" * 100_000,
    "3",
    "",
    "null",
    '{"step": "two"}',
    '{"step": NaN}',
    '{"steps": 2}',
    "1" * 10_000,
    "\x00",
    "é",
)


@pytest.mark.parametrize("damaged", DAMAGED)
def test_a_damaged_line_spoils_no_other(tmp_path, damaged):
    path = tmp_path / "rounds.jsonl"
    path.write_bytes(b'{"step": 1}\n' + damaged.encode("latin-1"))
    append_line(path, '{"step": 3}')
    written = path.read_bytes()
    assert whole_lines(path, 2**20, "a ledger", _step) == [1, 3]
    assert path.read_bytes() == written
    assert whole_lines(path, 2**20, "a ledger", _step, mend=True) == [1, 3]
    assert path.read_text() == '{"step": 1}\n{"step": 3}\n'


def test_a_file_that_cannot_be_read_is_told(tmp_path):
    (tmp_path / "large.jsonl").write_bytes(b"{}\n" * 100)
    for name, told in (("none", "not found"), ("large", "larger than")):
        with pytest.raises(RaucaError, match=told):
            whole_lines(tmp_path / f"{name}.jsonl", 64, "a ledger", lambda line: line)


def test_a_ledger_has_only_entries_of_their_own_kind(tmp_path):
    append_entry(tmp_path, LedgerEntry("a", "done", seconds=2.0))
    good = {"frame": "b", "state": "failed", "reason": "boom"}
    for wrong in ({"seconds": "fast"}, {"visible": []}, {"reason": 3}, {"state": "lost"}, {"frame": None}):
        append_line(tmp_path / "ledger.jsonl", json.dumps({**good, **wrong}))
    assert read_ledger(tmp_path) == {"a": LedgerEntry("a", "done", seconds=2.0)}
    told = [finding.what for finding in check_ledgers(tmp_path, {"a", "b"}, {"a"})]
    assert [what.partition(" (")[0] for what in told] == [f"line {n} is damaged" for n in range(2, 7)]


def _step(line: Fields) -> int:
    return line.integer("step")
