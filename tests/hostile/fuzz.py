"""Coverage-guided fuzzing of readers by hand; needs atheris, which is no dependency of rauca.

    pip install atheris
    nice -n 10 python -m tests.hostile.fuzz plan ledger --minutes 10

One reader after the other (all without names), each in a process of its own. The inputs are the reader's healthy file,
what ``corpus/<reader>/`` keeps, and what earlier runs found worth keeping in ``--work``. What is neither a result nor a
:class:`RaucaError` is told once for each place it comes from, and its input kept in ``<work>/findings``.

Readers inside Blender take part where bpy is installed, all but that of ``.blend`` files, which is Blender's own.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import shutil
import sys
import tempfile
import traceback
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


def main() -> None:
    """Fuzz the readers that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", metavar="READER", help=f"of {', '.join(READERS)}")
    parser.add_argument("--minutes", type=float, default=10.0, help="for each reader")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "rauca-fuzz")
    options = parser.parse_args()
    if unknown := set(options.readers) - set(READERS):
        parser.error(f"no reader {', '.join(sorted(unknown))}; see --help")
    for name in options.readers or READERS:
        print(f"READER {name}", file=sys.stderr, flush=True)
        end = monotonic() + 60 * options.minutes
        while monotonic() < end:  # libFuzzer's process ends with what hangs, crashes or fills the memory
            if not (child := os.fork()):  # imports are paid for once
                fuzz(READERS[name], end, options.work)
            os.waitpid(child, 0)


def fuzz(target: Target, end: float, work: Path) -> None:
    """Fuzz one reader until :func:`monotonic` reaches ``end``; ends the process."""
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
        return target.damage(data or healthy, rng)[:largest]

    # Each file's memory is bounded by the target; atheris keeps what comparisons of arrays gave, which adds up to this.
    limits = ["-rss_limit_mb=4096", "-timeout=60", "-max_len=300000"]
    quiet = ["-verbosity=0", f"-artifact_prefix={found}/{target.name}-"]
    seeds = [str(kept), *([str(CORPUS / target.name)] if (CORPUS / target.name).is_dir() else [])]
    atheris.Setup([sys.argv[0], *limits, *quiet, *seeds], test, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
