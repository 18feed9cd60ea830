"""Makes artifacts that their recipes describe: ``python -m rauca_core.study.worker [--machine JSON] FOLDER...``.

It is what a task of a cluster runs. Folders are of artifacts that are made together; progress is told as lines on
standard output, a mistake as one line on standard error and exit code 2.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from ..contract import Progress, RaucaError
from .artifact import read_recipe
from .executors import Task, do_task
from .job import Machine


def work(folders: Sequence[Path], machine: Machine) -> None:
    """Make the artifacts of folders whose inputs are finished."""
    artifacts = tuple(read_recipe(folder)[0] for folder in folders)
    inputs = tuple(tuple(one.place for one in artifact.inputs if one.place) for artifact in artifacts)
    do_task(Task(artifacts, tuple(folders), inputs), machine, tell)


def tell(progress: Progress) -> None:
    """For the process that waits."""
    print(progress.line(), flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit code."""
    parser = argparse.ArgumentParser(prog="rauca_core.study.worker", description=__doc__)
    parser.add_argument("--machine", type=json.loads, default=Machine().to_json())
    parser.add_argument("folders", type=Path, nargs="+")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        work(options.folders, Machine.from_json(options.machine))
    except RaucaError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        print("interrupted: what was finished is kept", file=sys.stderr, flush=True)
        return 2
    return 0


def _interrupt(number: int, stack: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
