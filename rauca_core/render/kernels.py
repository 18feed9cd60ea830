"""Compiled kernels that numba keeps from run to run as long as nothing that went into them has changed.

numba itself looks at a kernel's own file only: it would go on with what a changed file beside it once held, be it a
kernel that this one calls or a constant, and after an update keep the old taps under a new format.
"""

from __future__ import annotations

import hashlib
import inspect
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

_IMPORT = re.compile(r"^from (\.+)([\w.]*) import \(?([\w, ]*)", re.MULTILINE)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As ``numba.njit``; what ``cache=True`` keeps is stale once one of its file's :func:`sources` has changed."""

    def compiled(function: Callable[..., Any]) -> Any:
        kernel: Any = numba.njit(**options)(function)
        if options.get("cache") and kernel is not function:  # which it is where NUMBA_DISABLE_JIT is set
            # Written with every entry and compared at reading; numba has no public place for it.
            kernel._cache._cache_file._source_stamp = _stamp(Path(inspect.getfile(function)))
        return kernel

    return compiled


@cache
def sources(file: Path) -> frozenset[Path]:
    """A file and those that it imports by a relative name, and so on.

    Names that a package passes on are not followed: kernels and constants are imported from where they are defined.
    """
    found = {file}
    for dots, module, names in _IMPORT.findall(file.read_text(encoding="utf-8")):
        folder = file.parents[len(dots) - 1]
        places = [module.replace(".", "/")] if module else [name.strip() for name in names.split(",")]
        for place in places:
            path = folder / f"{place}.py"
            if path.is_file():
                found |= sources(path)
    return frozenset(found)


@cache
def _stamp(file: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(sources(file)):
        digest.update(path.read_bytes())
    return digest.hexdigest()
