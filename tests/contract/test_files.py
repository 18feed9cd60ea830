import errno
import io
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from rauca_core.contract import RaucaError
from rauca_core.contract.files import (
    append_line,
    atomic_folder,
    disk_errors,
    png_bytes,
    require_space,
    sweep_partials,
    write_bytes,
    write_json,
)


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (4, 9, 3)])
def test_png_is_what_pillow_reads_back(shape):
    pixels = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(pixels)))), pixels)


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    target = tmp_path / "a.json"
    write_json(target, {"old": 1})

    def full(*_):
        raise OSError(errno.ENOSPC, "disk full")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RaucaError, match=r"a\.json: no space left"):
        write_json(target, {"new": 2})
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
    assert "old" in target.read_text()
    # A file of a folder that is gone when the message is read: the folder above is named.
    with pytest.raises(RaucaError, match=f"^{tmp_path}: no space left"), atomic_folder(tmp_path / "b") as temporary:
        write_bytes(temporary / "c.png", b"")


def test_json_refuses_nan(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"x": float("nan")})
    assert not list(tmp_path.iterdir())


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "frame"
    with pytest.raises(KeyboardInterrupt), atomic_folder(target) as temporary:  # noqa: PT012 - the body is the point
        write_bytes(temporary / "half.png", b"half")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())
    with atomic_folder(target) as temporary:
        write_bytes(temporary / "whole.png", b"whole")
        assert not target.exists()
    assert (target / "whole.png").read_bytes() == b"whole"


def test_leftovers_of_a_killed_job_are_swept(tmp_path):
    (tmp_path / ".partial-abc").mkdir()
    (tmp_path / ".partial-def").write_text("x")
    (tmp_path / "kept").mkdir()
    sweep_partials(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["kept"]


def test_too_little_space_is_told_before_the_work_starts(tmp_path):
    with pytest.raises(RaucaError, match="MiB free"):
        require_space(tmp_path / "not" / "yet", 2**60)
    require_space(tmp_path, 1)


def test_other_disk_errors_pass_through(tmp_path):
    with pytest.raises(IsADirectoryError), disk_errors(tmp_path):
        raise IsADirectoryError(errno.EISDIR, "folder")


def test_a_line_cut_off_by_a_crash_spoils_no_other(tmp_path):
    (tmp_path / "ledger").write_text('whole\n{"fra')
    append_line(tmp_path / "ledger", "next")
    assert (tmp_path / "ledger").read_text().splitlines() == ["whole", '{"fra', "next"]


def test_a_disk_that_takes_half_a_line_is_told_and_the_line_comes_later(tmp_path):
    """In a process of its own, whose files may not grow past 100 bytes."""
    code = """
import resource, signal, sys
from pathlib import Path
from rauca_core.contract import RaucaError
from rauca_core.contract.files import append_line
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
append_line(Path(sys.argv[1]), "a" * 80)
try:
    append_line(Path(sys.argv[1]), "b" * 80)
except RaucaError as error:
    print(error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
append_line(Path(sys.argv[1]), "b" * 80)
"""
    ledger = tmp_path / "ledger"
    done = subprocess.run([sys.executable, "-c", code, str(ledger)], capture_output=True, text=True, check=True)
    assert "ledger: larger than files may be here" in done.stdout
    assert ledger.read_text().splitlines() == ["a" * 80, "b" * 19, "b" * 80]


@pytest.mark.parametrize("kind", ["link", "folder", "pipe"])
def test_nothing_is_appended_to_what_is_no_file_of_the_folder(tmp_path, kind):
    elsewhere, ledger = tmp_path / "mine", tmp_path / "ledger"
    elsewhere.write_text("precious")
    {"link": lambda: ledger.symlink_to(elsewhere), "folder": ledger.mkdir, "pipe": lambda: os.mkfifo(ledger)}[kind]()
    with pytest.raises(RaucaError, match="ledger: is no file of this folder"):
        append_line(ledger, "line")
    assert elsewhere.read_text() == "precious"
