"""Files of JSON lines: whole lines are read whatever lies between them."""

import json

import pytest

from rauca_core.contract import LedgerEntry, RaucaError, append_entry, read_ledger
from rauca_core.contract.files import append_line
from rauca_core.contract.schema import Fields, whole_lines
from rauca_core.dataset_tools.check import check_ledgers
from rauca_core.study.detection_cache import DetectionCache, DetectionSettings

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


def test_a_cache_of_detections_reads_its_whole_lines(tmp_path):
    cache = DetectionCache(tmp_path, "one", "abc", DetectionSettings())
    none = {"image": "none", "boxes": [], "scores": [], "names": []}
    two = {"image": "two", "boxes": [[0, 1, 2, 3], [4, 5, 6, 7]], "scores": [0.5, 0.25], "names": ["car", "bus"]}
    wrong = [
        {**two, "boxes": [[0, 1, 2, 3]]},
        {**two, "scores": [0.5, None]},
        {**two, "names": ["car"]},
        {**two, "boxes": [[0, 1, 2], [4, 5, 6]]},
        {**two, "image": 2},
    ]
    for line in (none, *wrong):
        append_line(cache.path, json.dumps(line))
    again = DetectionCache(tmp_path, "one", "abc", DetectionSettings())
    assert "two" not in again
    assert again["none"].boxes.shape == (0, 4)
    append_line(cache.path, json.dumps(two))
    found = DetectionCache(tmp_path, "one", "abc", DetectionSettings())["two"]
    assert found.boxes.tolist() == two["boxes"]
    assert (found.scores.tolist(), found.names) == ([0.5, 0.25], ("car", "bus"))


def _step(line: Fields) -> int:
    return line.integer("step")
