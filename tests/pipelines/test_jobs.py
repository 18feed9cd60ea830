"""Workers that die, supervisors that are killed, shards: the finished set is the same bytes. All processes are real."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import pytest

from rauca_core.contract import (
    LedgerEntry,
    RaucaError,
    RenderFrames,
    Shard,
    append_entry,
    balanced_frames,
    chunks,
    planned_frames,
    read_ledger,
    read_plan,
    save_job,
)

pytest.importorskip("bpy", reason="the bpy wheel is not installed")

from blender_addon import folders
from blender_addon.jobs import dataset_job
from blender_addon.jobs.child import child_command
from blender_addon.jobs.dataset_job import hold_cameras, sweep
from blender_addon.jobs.supervisor import Crew, Listener, Supervisor
from tests.pipelines.test_cli import command_lines
from tests.pipelines.test_headless import MAKE

# Two cameras, each in a street of its own; weathers of which one is composed from another, two share their light and
# one has rain over it; some frames rendered again in a check color.
WEATHERS = [
    {"name": "day", "sun_altitude_angle": 45, "sun_azimuth_angle": 60, "fog_density": 0},
    {"name": "fog", "sun_altitude_angle": 45, "sun_azimuth_angle": 60, "fog_density": 50},
    {"name": "night", "sun_altitude_angle": -90, "sun_azimuth_angle": 60, "fog_density": 0},
    {"name": "rain", "sun_altitude_angle": -30, "sun_azimuth_angle": 60, "fog_density": 0, "precipitation": 60},
]
SMALL = ["--locations", "2", "--azimuths", "1", "--elevations", "15", "--distances", "6", "--min-visible", "0"]
SMALL += ["--size", "48", "--samples", "1", "--no-denoise", "--composed-fog", "--recolor-share", "0.3"]


def options(folder: Path) -> list[str]:
    weathers = folder.absolute().parent / "weathers.json"
    weathers.parent.mkdir(exist_ok=True)
    weathers.write_text(json.dumps({"format": "rauca-weathers", "version": 1, "weathers": WEATHERS}))
    return ["--out", str(folder), "--weathers", str(weathers), *SMALL]


def start(folder: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(MAKE), *options(folder), *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(job: subprocess.Popen[str]) -> tuple[int, str]:
    _, complaint = job.communicate(timeout=300)
    return job.returncode, complaint.strip().splitlines()[-1] if complaint.strip() else ""


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a data set but its ledgers."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("ledger"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """An uninterrupted run."""
    folder = tmp_path_factory.mktemp("whole") / "set"
    assert finish(start(folder)) == (0, "")
    return folder


def supervise(folder: Path, whole: Path, news, workers: int = 1, recycle: int = 200):
    """Supervise in this process, so that ``news`` hears which worker renders what; plan and vehicle are ``whole``'s."""
    listener = Listener(lambda progress: None, lambda note: None, news)
    plan = read_plan(whole)
    order = folder.with_name("worker.json")
    save_job(order, RenderFrames(whole, folder, threads=1))
    command = child_command(order, 1)
    folder.mkdir(exist_ok=True)
    supervisor = Supervisor(folder, Shard(), Crew(command, workers, recycle), listener, lambda: None)
    supervisor.run([[f.id for f in chunk] for chunk in chunks(plan, planned_frames(plan), recycle)], 0)
    return supervisor


def test_recycled_workers_side_by_side_render_the_same_bytes(whole, tmp_path):
    frames_of = defaultdict(list)

    def news(worker, heard):
        if heard.event == "done":
            frames_of[worker.pid].append(heard.frame)

    supervise(tmp_path / "set", whole, news, workers=2, recycle=2)
    assert sum(map(len, frames_of.values())) == 8
    assert max(map(len, frames_of.values())) <= 2
    assert {k: v for k, v in content(whole).items() if k.startswith("frames")} == content(tmp_path / "set")


def test_a_balanced_part_goes_on_to_the_whole(whole, tmp_path):
    assert finish(start(tmp_path / "set", "--frames", "3")) == (0, "")
    plan = read_plan(tmp_path / "set")
    part = balanced_frames(plan, 3)
    assert sorted(read_ledger(tmp_path / "set")) == sorted(part)
    assert finish(start(tmp_path / "set")) == (0, "")
    assert content(tmp_path / "set") == content(whole)


def test_a_frame_that_fails_twice_is_quarantined_and_the_rest_goes_on(whole, tmp_path):
    folder = tmp_path / "set"
    shutil.copytree(whole, folder, ignore=shutil.ignore_patterns("frames", "ledger*"))
    unlucky, deadly, blocked = [frame.id for frame in planned_frames(read_plan(whole))][1:4]
    (folder / "frames").mkdir()
    (folder / "frames" / blocked).write_text("a file where the frame's folder should be")
    kills, pids = defaultdict(int), set()

    def news(worker, heard):
        pids.add(worker.pid)
        in_flight = heard.event == "begin" and heard.frame
        if in_flight and kills[heard.frame] < {unlucky: 1, deadly: 2}.get(heard.frame, 0):
            kills[heard.frame] += 1
            os.kill(worker.pid, signal.SIGKILL)

    supervisor = supervise(folder, whole, news)
    assert set(supervisor.quarantined) == {deadly, blocked}
    assert "killed by SIGKILL" in supervisor.quarantined[deadly]
    assert "NotADirectoryError" in supervisor.quarantined[blocked]
    # Three deaths, each followed by a fresh worker; Python's error in a frame cost none, but its second try wanted one.
    assert len(pids) <= 6
    states = {frame: entry.state for frame, entry in read_ledger(folder).items()}
    assert sorted(states.values()) == ["done"] * 6 + ["quarantined"] * 2
    failures = [line for line in (folder / "ledger.jsonl").read_text().splitlines() if '"failed"' in line]
    assert len(failures) == 3

    code, complaint = finish(start(folder))
    assert code == 2
    assert "2 frames failed twice and were left out" in complaint
    assert "--retry-quarantined" in complaint
    (folder / "frames" / blocked).unlink()
    assert finish(start(folder, "--retry-quarantined")) == (0, "")
    assert content(folder) == content(whole)


def test_killed_at_random_moments_then_finished(whole, tmp_path):
    """The supervisor by SIGKILL, its workers left to notice by themselves; the next run starts at once."""
    folder, chance = tmp_path / "set", random.Random(4)
    for _ in range(3):
        job = start(folder)
        begun = time.monotonic()
        while job.poll() is None and time.monotonic() < begun + 60:
            if job.stdout.readline().startswith(f"[{chance.randint(1, 4)}/"):
                time.sleep(chance.random())
                break
        job.kill()
        job.wait()
    assert finish(start(folder)) == (0, "")
    assert content(folder) == content(whole)
    assert set(read_ledger(folder)) == {frame.id for frame in planned_frames(read_plan(whole))}
    assert not [line for line in command_lines() if str(tmp_path) in line]


def killed(moment: str, *arguments: str) -> None:
    """Make a data set in a process that kills itself as soon as ``moment``, an expression, holds.

    It may speak of ``name``, what is about to be done (``os.replace`` or ``append_entry``), and of its ``target``.
    """
    code = f"""
import os, signal, sys
import bpy
from blender_addon.core import contract
from blender_addon.headless import run
from pipelines.dataset_options import dataset_job, dataset_parser
def watched(name, real):
    def call(first, target, *rest):
        if {moment}: os.kill(os.getpid(), signal.SIGKILL)
        return real(first, target, *rest)
    return call
os.replace = watched("os.replace", os.replace)
contract.append_entry = watched("append_entry", contract.append_entry)
sys.exit(run(lambda: dataset_job(dataset_parser().parse_args(sys.argv[1:])), as_json=False))
"""
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=300)
    assert done.returncode == -signal.SIGKILL, done.stderr


def test_a_vehicle_that_lies_there_without_a_plan_is_not_taken_for_ours(whole, tmp_path):
    """Killed between the two, then run with another vehicle: what is sealed is what was rendered."""
    folder = tmp_path / "set"
    killed(f"str(target) == {str(folder / 'dataset.json')!r}", "--vehicle", "suv", *options(folder))
    assert (folder / "vehicle" / "vehicle.json").is_file()
    assert list(folder.glob(".partial-*"))
    assert finish(start(folder)) == (0, "")
    assert content(folder) == content(whole)  # nor does anything under a temporary name stay behind


def test_a_frame_tried_again_and_killed_before_its_line_is_done(whole, tmp_path):
    folder = tmp_path / "set"
    shutil.copytree(whole, folder)
    frame = next(iter(read_ledger(whole)))
    shutil.rmtree(folder / "frames" / frame)
    append_entry(folder, LedgerEntry(frame, "quarantined", reason="no memory"))
    killed('name == "append_entry" and target.state == "done"', "--retry-quarantined", *options(folder))
    assert (folder / "frames" / frame).is_dir()
    assert finish(start(folder)) == (0, "")
    assert read_ledger(folder)[frame].state == "done"


def test_a_data_set_that_was_moved_goes_on(whole, tmp_path, monkeypatch):
    """By its new name, and from inside it, where it has none."""
    folder = tmp_path / "another"
    shutil.copytree(whole, folder)
    shutil.rmtree(next((folder / "frames").iterdir()))
    assert finish(start(folder)) == (0, "")
    assert content(folder) == content(whole)
    monkeypatch.chdir(folder)
    assert finish(start(Path())) == (0, "")
    assert content(folder) == content(whole)


def test_shards_at_the_same_time_make_the_whole(whole, tmp_path):
    folder = tmp_path / "set"
    jobs = [start(folder, "--shard", f"{i}/2") for i in (1, 2)]
    assert [finish(job) for job in jobs] == [(0, ""), (0, "")]
    assert content(folder) == content(whole)
    assert sorted(path.name for path in folder.glob("ledger*")) == ["ledger-1of2.jsonl", "ledger-2of2.jsonl"]


def test_a_lock_outlives_no_process_and_names_its_holder(whole, tmp_path, monkeypatch):
    code = (
        "import sys; from pathlib import Path; from rauca_core.contract import Shard, read_plan\n"
        "from blender_addon.jobs.dataset_job import hold_cameras\n"
        "with hold_cameras(Path(sys.argv[1]), read_plan(Path(sys.argv[2])), Shard(1, 2)):\n"
        "    print('held', flush=True); sys.stdin.read()"
    )
    folder = tmp_path / "set"
    plan = read_plan(whole)
    command = [sys.executable, "-c", code, str(folder), str(whole)]
    other = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert "held\n" in iter(other.stdout.readline, "")  # importing bpy may say something before
    with hold_cameras(folder, plan, Shard(2, 2)) as lock:
        (folder / "frames").mkdir()
        (folder / "frames" / ".partial-of-a-neighbor").mkdir()
        (folder / ".partial-plan").write_text("{")
        sweep(folder, lock)
        assert list((folder / "frames").iterdir())  # it may still be written
        assert (folder / ".partial-plan").is_file()
    code, complaint = finish(start(folder))
    assert code == 2
    assert f"is being rendered by process {other.pid} on {socket.gethostname()} (shard 1/2)" in complaint
    vast = '{"first": 0, "end": 1e30, "shard": "1/1", "pid": 1, "host": "x"}'
    (folder / ".lock").write_text(f"{'[' * 5000}\n{vast}\n{vast.replace('1e30', '1' * 40)}\n3\n")
    monkeypatch.setattr(dataset_job, "PATIENCE_S", 0.2)  # real patience was tried above
    with pytest.raises(RaucaError, match="rendered by another process"), hold_cameras(folder, plan, Shard()):
        pass
    other.kill()
    other.wait()
    with hold_cameras(folder, plan, Shard()) as lock:
        sweep(folder, lock)
        assert not list((folder / "frames").iterdir())
        assert [path.name for path in folder.iterdir() if path.name != ".lock"] == ["frames"]
    (folder / "frames").rmdir()
    with hold_cameras(folder, plan, Shard()):
        pass
    assert not folder.exists()  # an empty folder is not left behind

    (tmp_path / "mine").write_text("precious")
    for place in (tmp_path / "mine", tmp_path / "mine" / "set"):
        with pytest.raises(RaucaError, match=r"mine.*: is a file; choose"), hold_cameras(place, plan, Shard()):
            pass


def test_scratch_folders_of_killed_processes_are_swept(monkeypatch):
    code = "import time; from blender_addon.folders import scratch_folder\n"
    code += "with scratch_folder(in_memory=True) as folder: print(folder, flush=True); time.sleep(99)"
    other = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    folder = Path(next(line.strip() for line in other.stdout if line.startswith("/")))  # bpy may say something before
    monkeypatch.setattr(folders, "NEWBORN_S", -1.0)
    folders.sweep_scratch()
    assert folder.is_dir()  # in use
    other.kill()
    other.wait()
    assert folders.sweep_scratch() >= 1
    assert not folder.exists()
    with folders.scratch_folder(in_memory=True) as mine:
        assert mine.is_dir()
    assert not mine.exists()
