import json

import pytest

from rauca_core.contract import RaucaError
from rauca_core.contract.schema import Fields, read_json


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
