"""Every reader, damaged files: a result or one sentence, in bounded memory and time, and nothing else is touched."""

from __future__ import annotations

import os
from collections.abc import Callable, Container
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rauca_core.contract import RaucaError

from .nasty import NASTY
from .readers import READERS
from .target import Target

torch.set_num_threads(1)
EXAMPLES = 20
SLOW = {"extractor-weights", "published-weights", "transformers", "detector-card", "tensorflow-server", "frame-json"}
EXAMPLES_IF_SLOW = 6
CORPUS = Path(__file__).with_name("corpus")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Target], tuple[Path, bytes]]:
    """A reader's valid folder, built once, and the healthy bytes of the file that is to be damaged."""
    made: dict[str, tuple[Path, bytes]] = {}

    def build(target: Target) -> tuple[Path, bytes]:
        if target.name not in made:
            folder = tmp_path_factory.mktemp(target.name) / "inside"
            made[target.name] = folder, target.seed(folder)
        return made[target.name]

    return build


def everything(folder: Path) -> dict[str, int]:
    """All files around a folder, with when they were written."""
    return {str(path): path.stat().st_mtime_ns for path in folder.parent.rglob("*") if path.is_file()}


def read_and_leave_alone(target: Target, folder: Path, data: bytes) -> RaucaError | None:
    """Read damaged bytes; fails unless that ends in a result or one line, with all files as they were."""
    (folder / target.file).write_bytes(data)
    before = everything(folder)
    complaint = target.complaint(folder)
    assert complaint is None or "\n" not in str(complaint).strip()
    if not target.writes and not target.signs:
        assert everything(folder) == before
    return complaint


def for_damaged(target: Target, healthy: bytes, examples: int, read: Callable[[bytes], object]) -> None:
    """Read the file damaged in some ways, the same in every run."""

    @settings(
        derandomize=True, deadline=None, max_examples=examples, suppress_health_check=list(HealthCheck), database=None
    )
    @given(st.randoms(use_true_random=False))
    def damaged(rng):
        read(target.damage(healthy, rng))

    damaged()


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_refused(name, built):
    target = READERS[name]
    folder, healthy = built(target)

    examples = EXAMPLES_IF_SLOW if name in SLOW else EXAMPLES
    for_damaged(target, healthy, examples, lambda data: read_and_leave_alone(target, folder, data))


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_device_or_folder_is_no_file(name, built, tmp_path):
    """Opened, a pipe would wait for ever and a device fill the memory."""
    target = READERS[name]
    folder = tmp_path / "inside"
    target.seed(folder)
    for make in (os.mkfifo, lambda path: path.symlink_to("/dev/zero"), os.mkdir, lambda path: path.symlink_to(path)):
        (folder / target.file).unlink() if not (folder / target.file).is_dir() else os.rmdir(folder / target.file)
        make(folder / target.file)
        target.complaint(folder)


@pytest.mark.parametrize(("name", "title", "make", "words"), NASTY, ids=[f"{n[0]}: {n[1]}" for n in NASTY])
def test_what_was_made_to_hurt(name, title, make, words, built, monkeypatch, tmp_path):
    target = READERS[name]
    folder, healthy = built(target)
    monkeypatch.chdir(tmp_path)  # where a trap would leave its trace
    complaint = read_and_leave_alone(target, folder, make(healthy))
    assert not list(tmp_path.iterdir())
    if words is not None:
        assert complaint is not None, "was read"
        assert any(word in str(complaint) for word in words.split("|")), str(complaint)


def kept(readers: Container[str]) -> list[Path]:
    """What fuzzing found in these readers; those inside Blender are tried where Blender is."""
    return sorted(path for path in CORPUS.glob("*/*") if path.parent.name in readers)


@pytest.mark.parametrize("path", kept(READERS), ids=lambda path: f"{path.parent.name}-{path.name[:12]}")
def test_what_fuzzing_found(path, built):
    target = READERS[path.parent.name]
    read_and_leave_alone(target, built(target)[0], path.read_bytes())


def test_healthy_files_are_read(built):
    """Else the damage would prove nothing."""
    unfinished = {"detector-card", "transformers"}  # their weights are another network's: too large to keep here
    for target in READERS.values():
        folder, healthy = built(target)
        complaint = read_and_leave_alone(target, folder, healthy)
        assert (complaint is None) == (target.name not in unfinished), complaint
