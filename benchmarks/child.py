"""A benchmark's part that needs Blender, in a process of its own."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Mapping, Sequence

from rauca_core.contract import Progress, RaucaError, parse_progress


def run_child(
    bench: str,
    command: Sequence[str],
    progress: Callable[[Progress], None],
    environment: Mapping[str, str] | None = None,
) -> None:
    """Run ``command`` to its end, passing its progress on; what it wrote last tells why it failed.

    Args:
        bench: the benchmark's name, for the complaint.
        environment: variables beside the present ones.

    Raises:
        RaucaError: it ended with another code than 0.
    """
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | dict(environment or {}),
    )
    tail = "no message"
    try:
        for line in process.stdout or ():
            if news := parse_progress(line):
                progress(news)
            elif line.strip():
                tail = line.strip()
        code = process.wait()
    except BaseException:
        process.kill()
        process.wait()
        raise
    if code:
        raise RaucaError(f"bench {bench}: Blender stopped with code {code}: {tail}")
