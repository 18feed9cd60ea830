"""Compiled kernels that numba keeps from run to run as long as nothing that went into them has changed.

numba itself looks at a kernel's own file only: it would go on with what a changed file beside it once held, be it a
kernel that this one calls or a constant, and after an update keep the old taps under a new format. So every version of
the sources has a cache folder of its own.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

RUNTIME = Path(__file__).parent
RENDER = RUNTIME.parent / "render"
_LOCK = threading.Lock()  # threads may import kernels at the same time, and numba's setting is everyone's


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As ``numba.njit``; what ``cache=True`` keeps lies in the kernel's :func:`cache_folder`."""

    def compiled(function: Callable[..., Any]) -> Any:
        config: Any = numba.config
        with _LOCK:
            before = config.CACHE_DIR
            config.CACHE_DIR = str(cache_folder(Path(inspect.getfile(function)).parent, before))
            try:
                return numba.njit(**options)(function)
            finally:
                config.CACHE_DIR = before

    return compiled


@cache
def cache_folder(package: Path, chosen: str = "") -> Path:
    """Where a folder's kernels are kept, named by the sources in it and in `render`, whose kernels all others call.

    In ``chosen`` (NUMBA_CACHE_DIR), else beside the sources, else, where these are read-only, in the user's cache.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted({*RENDER.rglob("*.py"), *package.glob("*.py")}):
        digest.update(path.read_bytes())
    root = Path(chosen) if chosen else RUNTIME / "__pycache__"
    if not chosen and not os.access(RUNTIME, os.W_OK):
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rauca" / "kernels"
    return root / digest.hexdigest()[:16]
