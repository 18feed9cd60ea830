"""``rauca detectors`` and ``rauca weights`` as a user types them."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import RaucaError
from rauca_core.detect import SOURCES


def test_the_list_names_every_detector_and_what_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    shown = CliRunner().invoke(app, ["detectors", "list"], catch_exceptions=False).stdout
    for source in SOURCES.values():
        assert source.name in shown
        if source.files:
            assert f"{source.name}: rauca weights fetch {source.name}" in shown
    assert "sparse-rcnn_r50_fpn_1x_coco.py" in shown
    assert "yolov3-tiny" in CliRunner().invoke(app, ["weights", "list"], catch_exceptions=False).stdout


def test_a_learning_rate_of_nothing_is_refused(tmp_path: Path) -> None:
    command = ["detectors", "train", "frcnn-synth", str(tmp_path), "--out", str(tmp_path / "out"), "--lr", "0"]
    with pytest.raises(RaucaError, match=r"lr: .*greater than 0, not 0"):
        CliRunner().invoke(app, command, catch_exceptions=False)


def test_what_cannot_be_had_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    with pytest.raises(RaucaError, match=r"2 of 2 could not be fetched: yolov3-tiny, yolox-s; see above"):
        CliRunner().invoke(app, ["weights", "fetch", "yolov3-tiny", "yolox-s"], catch_exceptions=False)
    with pytest.raises(RaucaError, match="nothing to fetch; give names"):
        CliRunner().invoke(app, ["weights", "fetch"], catch_exceptions=False)
    with pytest.raises(RaucaError, match="yolox-s: rauca does not fetch these weights; get them with"):
        CliRunner().invoke(app, ["weights", "fetch", "yolox-s"], catch_exceptions=False)
