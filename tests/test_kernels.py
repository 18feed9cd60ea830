"""A compiled kernel is kept as long as nothing that went into it has changed."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

from rauca_core.runtime import kernels

HOUSE = Path(kernels.__file__).parents[1]
FILES = {
    "outer.py": """
from rauca_core.runtime.kernels import njit
from .inner import twice
from . import spare

@njit(cache=True)
def outer(x):
    return twice(x) + 1
""",
    "inner.py": """
from rauca_core.runtime.kernels import njit
from .constants import FACTOR

@njit(cache=True)
def twice(x):
    return FACTOR * x
""",
    "constants.py": "FACTOR = 2",
    "spare.py": "",
    "__init__.py": "",
}


class Package:
    """A package of two kernels, a constant, and a file that they have nothing to do with."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder / name, name
        self.folder.mkdir()
        for file, text in FILES.items():
            self.write(file, text)

    def write(self, file: str, text: str) -> None:
        (self.folder / file).write_text(text)

    def run(self) -> tuple[int, bool]:
        """What the outer kernel makes of 10 in a process of its own, as it were, and whether it came from the cache."""
        for name in [name for name in sys.modules if name.partition(".")[0] == self.name]:
            del sys.modules[name]
        importlib.invalidate_caches()
        kernels.cache_folder.cache_clear()
        outer: Any = importlib.import_module(f"{self.name}.outer").outer
        return outer(10), bool(outer.stats.cache_hits)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Package:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python tells two versions apart by whole seconds
    return Package(tmp_path, "kernels_of_a_test")


def test_kernels_come_from_the_cache(package: Package) -> None:
    assert package.run() == (21, False)
    assert package.run() == (21, True)


@pytest.mark.parametrize(
    ("file", "before", "after", "result"),
    [("inner.py", "FACTOR * x", "FACTOR * x + 4", 25), ("constants.py", "2", "3", 31), ("spare.py", "", "A = 1", 21)],
)
def test_a_change_in_a_file_that_went_into_a_kernel_compiles_it_anew(
    package: Package, file: str, before: str, after: str, result: int
) -> None:
    package.run()
    package.write(file, FILES[file].replace(before, after) if before else after)
    assert package.run() == (result, False)
    assert package.run() == (result, True)


def test_the_house_compiles_by_it() -> None:
    for file in HOUSE.rglob("*.py"):
        if file.name != "kernels.py":
            assert not re.search(r"^from numba import .*njit|numba\.njit", file.read_text(), re.MULTILINE), file
