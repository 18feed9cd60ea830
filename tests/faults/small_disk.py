"""A real disk of a few megabytes that fills up and turns read-only, without a privilege where the kernel allows it.

It is a tmpfs in a mount namespace of its own. A process that sleeps keeps the namespace; jobs enter it, the tests look
at it through ``/proc``, and it is gone with the sleeper, however the tests end.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.faults.running import Surroundings

SIZE = "24m"
ROOM = "echo ready; exec sleep 3600"
WAYS = (["unshare", "--mount"], ["unshare", "--user", "--map-root-user", "--mount"])


@dataclass(frozen=True)
class SmallDisk:
    """The disk as long as it is mounted.

    Attributes:
        place: where jobs find it.
        seen: the same folder, for the tests.
        around: what to start jobs with.
    """

    place: Path
    seen: Path
    around: Surroundings
    holder: int

    def fill(self) -> None:
        """Leave no byte free."""
        with (self.seen / "ballast").open("wb", buffering=0) as stream, contextlib.suppress(OSError):
            while True:
                stream.write(bytes(1 << 12))

    def free(self) -> None:
        """Give the space back."""
        (self.seen / "ballast").unlink()

    def remount(self, options: str) -> None:
        """``ro`` or ``rw``."""
        user = ["--user", "--preserve-credentials"] if len(self.around.namespaces) > 1 else []
        inside = ["nsenter", f"--target={self.holder}", *user, "--mount"]
        subprocess.run([*inside, "mount", "-o", f"remount,{options}", str(self.place)], check=True, capture_output=True)


@contextlib.contextmanager
def small_disk(place: Path) -> Iterator[SmallDisk | None]:
    """Mount a small disk over ``place``, an empty folder; None where this machine does not let us."""
    for way in WAYS if shutil.which("unshare") and shutil.which("nsenter") else ():
        script = f'mount -t tmpfs -o size={SIZE} none "$1" && {ROOM}'
        holder = subprocess.Popen([*way, "sh", "-c", script, "sh", str(place)], stdout=subprocess.PIPE, text=True)
        try:
            assert holder.stdout is not None
            if holder.stdout.readline() != "ready\n":
                continue
            names = ("user", "mnt") if "--user" in way else ("mnt",)
            around = Surroundings(namespaces=[Path(f"/proc/{holder.pid}/ns/{name}") for name in names])
            seen = Path(f"/proc/{holder.pid}/root{place}")
            os.listdir(seen)
            yield SmallDisk(place, seen, around, holder.pid)
            return
        finally:
            holder.kill()
            holder.wait()
    yield None
