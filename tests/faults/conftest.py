"""Inputs that all faults share, what every job makes when nothing goes wrong, and what it leaves when it is stopped."""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.stability.drawn import make_dataset, painted_box
from tests.detect.conftest import cfg_of, write_random_weights
from tests.faults.jobs import Begun, GoesOn, Inputs, Job, Whole
from tests.faults.running import ORDINARY, Running, Surroundings, ensure_server, rauca
from tests.faults.small_disk import SmallDisk, small_disk

# Two layers and a head: what detectors find is of no interest here, that they are alike from run to run is.
TINY = """
net width=32 height=32 channels=3
convolutional filters=8 size=3 stride=8 pad=1 activation=leaky
convolutional filters=7 size=1 stride=1 pad=1 activation=linear
yolo mask=0 anchors=20,22 classes=2 num=1
"""


@pytest.fixture(scope="session")
def clock(tmp_path_factory: pytest.TempPathFactory) -> Path | None:
    """A library whose wall clock jumps, see `clock.c`; None without a compiler."""
    library = tmp_path_factory.mktemp("clock") / "clock.so"
    source = Path(__file__).with_name("clock.c")
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(source)], check=True)
    return library


@pytest.fixture(scope="session", autouse=True)
def _surroundings(clock: Path | None) -> None:
    """What the server of jobs is started in: threads only get in each other's way on small images."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        patch.setenv("NUMBA_NUM_THREADS", "1")
        if clock is not None:
            patch.setenv("LD_PRELOAD", str(clock))
        ensure_server()


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    """A drawn data set of eight frames and a detector with random weights; copied where a test spoils them."""
    folder = tmp_path_factory.mktemp("inputs")
    data = make_dataset(folder / "data", painted_box(), 32, (40.0, 130.0, 220.0, 310.0))
    cfg = folder / "tiny.cfg"
    cfg.write_text(cfg_of(TINY))
    cfg.with_suffix(".names").write_text("boat\ncar\n")
    return Inputs(data.folder, write_random_weights(cfg.with_suffix(".weights"), cfg))


@pytest.fixture(scope="session")
def finished(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Callable[[Job], Path]:
    """The folder of a job that nothing happens to; made once, copied where a test spoils it."""
    made: dict[str, Path] = {}

    def of(job: Job) -> Path:
        if job.name not in made:
            folder = tmp_path_factory.mktemp("finished")
            ended = rauca(job.words(inputs, folder / "out"), folder / "log")
            assert ended.code == 0, ended.said
            made[job.name] = folder / "out"
        return made[job.name]

    return of


@pytest.fixture(scope="session")
def whole(finished: Callable[[Job], Path]) -> Whole:
    """What lies in that folder."""
    return lambda job: job.content(finished(job))


@pytest.fixture(scope="session")
def begun(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> Begun:
    """Puts a folder in place in which a job was stopped by SIGTERM half-way; stopped once, copied for each test."""
    stopped: dict[str, Path] = {}

    def copy(job: Job, out: Path) -> Path:
        if job.name not in stopped:
            folder = tmp_path_factory.mktemp("begun")
            out_of_it, before = folder / "out", job.pulse(folder / "out")
            running = Running(job.words(inputs, out_of_it), folder / "log")
            running.until(lambda: job.pulse(out_of_it) != before).signal(signal.SIGTERM)
            assert any(told in running.wait().complaint for told in ("stopped", "interrupted"))
            assert not list(out_of_it.rglob(".lock"))
            stopped[job.name] = out_of_it
        shutil.copytree(stopped[job.name], out, dirs_exist_ok=True)
        return out

    return copy


@pytest.fixture
def goes_on(inputs: Inputs, whole: Whole, tmp_path: Path) -> GoesOn:
    """Runs a job to its end: it leaves what one makes that nothing happens to, and nothing half-written."""

    def run(job: Job, out: Path, around: Surroundings = ORDINARY, seen: Path | None = None, data: Path | None = None):
        words = job.words(replace(inputs, data=data or inputs.data), out)
        ended = rauca(words, tmp_path / "log", around)
        assert ended.code == 0, ended.said
        assert job.content(seen or out) == whole(job)
        assert not list((seen or out).rglob(".partial-*"))

    return run


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    """A small disk of this test's own."""
    place = tmp_path / "disk"
    place.mkdir()
    with small_disk(place) as mounted:
        if mounted is None:
            pytest.skip("this machine does not let us mount a disk: no privilege, no user namespaces")
        yield mounted
