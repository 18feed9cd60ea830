"""Coverage-guided fuzzing of readers by hand; needs atheris, which is no dependency of rauca.

    pip install atheris
    nice -n 10 python -m tests.hostile.fuzz plan ledger --minutes 10
    python -m tests.hostile.fuzz --figures

One reader after the other (all without names), each in a process of its own. The inputs are the reader's healthy file,
what ``corpus/<reader>/`` keeps, and what earlier runs found worth keeping in ``--work``. What is neither a result nor a
:class:`RaucaError` is told once for each place it comes from, and its input kept in ``<work>/findings``.

Readers inside Blender take part where bpy is installed, all but that of ``.blend`` files, which is Blender's own.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import os
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from ctypes import c_uint64
from multiprocessing.sharedctypes import RawValue
from pathlib import Path
from random import Random
from time import monotonic

import atheris

HOUSE = Path(__file__).resolve().parents[2] / "rauca_core"


def _compiled() -> list[str]:
    """Modules of the rooms with numba's kernels: it compiles their bytecode, which atheris would change."""
    files = (path for room in ("render", "geometry", "attack", "environment") for path in (HOUSE / room).rglob("*.py"))
    return [".".join(path.relative_to(HOUSE.parent).with_suffix("").parts) for path in files]


# One by one: atheris knows whole packages to include, and single modules to leave out.
with atheris.instrument_imports(include=["rauca_core", "blender_addon"], exclude=_compiled()):
    from tests.hostile.readers import READERS
    from tests.hostile.target import Target

    if importlib.util.find_spec("bpy"):
        from tests.hostile.blender_targets import TARGETS

        READERS |= {target.name: target for target in TARGETS if target.name != "blend"}

CORPUS = Path(__file__).with_name("corpus")
HOURS = "hours.csv"  # in the work folder: a line a run, reader, executions, CPU seconds


def main() -> None:
    """Fuzz the readers that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", metavar="READER", help=f"of {', '.join(READERS)}")
    parser.add_argument("--minutes", type=float, default=10.0, help="for each reader")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "rauca-fuzz")
    parser.add_argument("--figures", action="store_true", help="print what all runs came to, and stop")
    options = parser.parse_args()
    if options.figures:
        if not (options.work / HOURS).is_file():
            parser.error(f"{options.work}: nothing was fuzzed there")
        print_figures(options.work)
        return
    if unknown := set(options.readers) - set(READERS):
        parser.error(f"no reader {', '.join(sorted(unknown))}; see --help")
    for name in options.readers or READERS:
        print(f"READER {name}", file=sys.stderr, flush=True)
        end = monotonic() + 60 * options.minutes
        while monotonic() < end:  # libFuzzer's process ends with what hangs, crashes or fills the memory
            fuzz_in_child(READERS[name], end, options.work)


def fuzz_in_child(target: Target, end: float, work: Path) -> None:
    """Fuzz one reader in a process of its own until it ends, and note what it came to; imports are paid for once."""
    work.mkdir(parents=True, exist_ok=True)
    executions = RawValue(c_uint64)  # shared with the child, which may end at any moment
    child = os.fork()
    if not child:
        fuzz(target, end, work, executions)
    used = os.wait4(child, 0)[2]
    with (work / HOURS).open("a", newline="") as file:
        csv.writer(file).writerow([target.name, executions.value, f"{used.ru_utime + used.ru_stime:.1f}"])


def print_figures(work: Path) -> None:
    """What all runs in a work folder came to, a Markdown table."""
    executions, seconds = Counter[str](), Counter[str]()
    with (work / HOURS).open(newline="") as file:
        for name, count, cpu_s in csv.reader(file):
            executions[name] += int(count)
            seconds[name] += float(cpu_s)
    print("| reader | executions | CPU minutes |\n|---|---|---|")
    for name in sorted(executions):
        print(f"| {name} | {executions[name]:,} | {seconds[name] / 60:.1f} |")
    print(f"| all {len(executions)} | {executions.total():,} | {seconds.total() / 60:.1f} |")


def fuzz(target: Target, end: float, work: Path, executions: c_uint64) -> None:
    """Fuzz one reader until :func:`monotonic` reaches ``end``, counting each input; ends the process."""
    found, kept = work / "findings", work / "corpus" / target.name
    for folder in (found, kept):
        folder.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
    healthy = target.seed(folder)
    (kept / "healthy").write_bytes(healthy)
    told: set[str] = set()

    def test(data: bytes) -> None:
        if monotonic() > end:
            shutil.rmtree(folder, ignore_errors=True)
            os._exit(0)  # not libFuzzer's own end: leaving the usual way, bpy aborts in its threads' destructors
        executions.value += 1
        try:
            target.try_on(folder, data)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            trace = traceback.extract_tb(error.__traceback__)
            frames = [f for f in trace if "rauca" in f.filename] or list(trace)
            place = f"{target.name}-{type(error).__name__}-{Path(frames[-1].filename).stem}-{frames[-1].lineno}"
            if place not in told:
                told.add(place)
                (found / place).write_bytes(data)
                print(f"FINDING {place}: {str(error)[:200]}", file=sys.stderr, flush=True)
            if target.writes:
                target.seed(folder)

    def mutate(data: bytes, largest: int, seed: int) -> bytes:
        rng = Random(seed)
        if rng.random() < 0.4:
            return bytes(atheris.Mutate(data, largest))
        return target.damaged(data or healthy, rng)[:largest]

    # Each file's memory is bounded by the target; atheris keeps what comparisons of arrays gave, which adds up to this.
    limits = ["-rss_limit_mb=4096", "-timeout=60", "-max_len=300000"]
    quiet = ["-verbosity=0", f"-artifact_prefix={found}/{target.name}-"]
    seeds = [str(kept), *([str(CORPUS / target.name)] if (CORPUS / target.name).is_dir() else [])]
    atheris.Setup([sys.argv[0], *limits, *quiet, *seeds], test, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
