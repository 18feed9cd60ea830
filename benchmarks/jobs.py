"""``rauca bench jobs``: memory of a data set's jobs stays flat, and being killed changes no byte."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from blender_addon.jobs.supervisor import Crew, Listener, Supervisor
from blender_addon.jobs.workers import News, Worker
from pipelines.console import progress_bar
from rauca_core import contract
from rauca_core.contract.assets import assets_folder
from rauca_core.runtime.blender import blender_command
from rauca_core.runtime.images import read_image

from .harness import Results, Settings

SIZE = 48
SMALL = f"--elevations 15 --distances 6 --size {SIZE} --samples 1 --no-denoise --json-progress".split()
MAKE = [sys.executable, str(Path(__file__).resolve().parent.parent / "pipelines" / "make_dataset.py")]

FULL = Settings(frames=500, kills=20, killed_views=20)
QUICK = FULL.but(frames=100, kills=5)


def bench(out: Path, settings: Settings) -> Results:
    """Measure ``memory``, MiB by frame and its growth from frame 50, CPU seconds of a ``chunk``, and ``kills``."""
    results = Results("jobs", settings)
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        kills = measure_kills(Path(temporary), settings.kills, settings.killed_views)
        memory, chunk = measure_worker(Path(temporary), settings.frames)
    results.figures |= {"memory": memory, "chunk": chunk, "kills": kills}
    shown = {k: v for found in (kills, memory, chunk) for k, v in found.items() if k != "resident_mib"}
    rows = [
        {"what": name.replace("_", " "), "found": f"{value:.4g}" if isinstance(value, float) else value}
        for name, value in shown.items()
    ]
    results.table("Jobs of a data set", {"what": "{what}", "found": "{found}"}, rows)
    results.publish(out)
    return results


def measure_kills(place: Path, kills: int, views: int) -> dict[str, Any]:
    """Make a set of ``3 * views`` frames once in peace, and once under SIGKILLs at random moments."""
    options = [*SMALL, "--azimuths", str(views)]
    peaceful, hunted = place / "peaceful" / "set", place / "hunted" / "set"
    started = time.monotonic()
    subprocess.run([*MAKE, "--out", str(peaceful), *options], check=True, stdout=subprocess.DEVNULL)
    pace_s = (time.monotonic() - started) / (3 * views)
    command = [*MAKE, "--out", str(hunted), *options, "--retry-quarantined"]
    hit = _hunt(command, kills, pace_s)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return {"frames": 3 * views, "killed": hit, "identical": _content(peaceful) == _content(hunted)}


def _hunt(command: list[str], kills: int, pace_s: float) -> dict[str, int]:
    """Run a command again and again, killing it or its worker after a few lines and a random wait."""
    chance, hit = random.Random(0), {"supervisor": 0, "worker": 0}
    job = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    while sum(hit.values()) < kills:
        for _ in range(chance.randint(0, 3)):
            next(iter(job.stdout or ()), None)
        time.sleep(2 * pace_s * chance.random())
        if job.poll() == 0:
            break  # finished before it was killed often enough; the counts tell
        children = Path(f"/proc/{job.pid}/task/{job.pid}/children")
        workers = [int(child) for child in children.read_text().split()] if children.exists() else []
        victim = "worker" if workers and chance.random() < 0.4 else "supervisor"
        with contextlib.suppress(ProcessLookupError):  # it ended by itself meanwhile
            os.kill(workers[0] if victim == "worker" else job.pid, signal.SIGKILL)
            hit[victim] += 1
        if victim == "supervisor":
            job.communicate()
            job = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    job.communicate()
    return hit


def _content(folder: Path) -> dict[Path, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("ledger"))
    return {path.relative_to(folder): path.read_bytes() for path in files}


class _Watch:
    """What a worker costs, by its news: resident MiB after each frame, CPU seconds by what they went into."""

    def __init__(self) -> None:
        self.resident_mib: list[float] = []
        self.cpu_s = {"start": 0.0, "coverage": 0.0, "frames": 0.0}
        self._spent_s, self._doing = 0.0, "coverage"

    def hear(self, worker: Worker, news: News) -> None:
        """Its user and system time so far goes to what it has just done; a chunk begins with coverage."""
        # The name in the second field may hold spaces.
        fields = Path(f"/proc/{worker.pid}/stat").read_text().rpartition(")")[2].split()
        spent_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        if news.event in ("done", "occluded"):
            self._doing = "frames"
            pages = int(Path(f"/proc/{worker.pid}/statm").read_text().split()[1])
            self.resident_mib.append(pages * os.sysconf("SC_PAGE_SIZE") / 2**20)
        self.cpu_s["start" if news.event == "ready" else self._doing] += spent_s - self._spent_s
        self._spent_s = spent_s
        if news.event == "idle":
            self._doing = "coverage"


def measure_worker(place: Path, frames: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """One worker renders all frames, four locations in three weathers, with the sedan in the town."""
    views = -(-frames // 12)
    vehicle = contract.load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)
    plan = contract.Plan(
        name="jobs", vehicle_name=vehicle.name, atlas_id=vehicle.atlas_id, size=SIZE,
        quality=contract.Quality(1, denoise=False), light=True,
        weathers=tuple(contract.find_preset("demo")),
        ring=contract.Ring(tuple(i * 360 / views for i in range(views)), (15.0,), (6.0,)), locations=4,
        reference_srgb=(140, 140, 140), min_visible=0.0, seed=0, blender="",
    )  # fmt: skip
    folder = place / "long"
    contract.claim_folder(folder, plan)
    vehicle.save(folder / "vehicle")
    contract.save_job(place / "worker.json", contract.RenderFrames(folder, folder))
    crew = Crew(blender_command(place / "worker.json"), recycle=10 * frames)
    watch, wanted = _Watch(), contract.planned_frames(plan)[:frames]
    pieces = [[frame.id for frame in chunk] for chunk in contract.chunks(plan, wanted, frames)]
    with progress_bar("rendering for memory", resumes=False) as move:
        listener = Listener(move, print, watch.hear)
        Supervisor(folder, contract.Shard(), crew, listener, lambda: None).run(pieces, 0)
    at, last = watch.resident_mib[49], watch.resident_mib[-1]
    memory = {
        "frames": len(wanted), "resident_mib_at_50": at, "resident_mib_at_end": last, "growth": last / at - 1,
        "resident_mib": watch.resident_mib,
    }  # fmt: skip
    chunk = {
        "start_cpu_s": watch.cpu_s["start"],
        "coverage_cpu_s_per_camera": watch.cpu_s["coverage"] / len({frame.camera for frame in wanted}),
        "cpu_s_per_frame": watch.cpu_s["frames"] / len(wanted),
    }
    return memory, chunk
