"""The arrows between modules: no cycles, one way through the rooms, and CONTRIBUTING's map says what is so.

Imports are read from the source, those inside functions and those for type checkers too: an import put off until a
function runs is as much of an arrow as one at the top.
"""

from __future__ import annotations

import ast
import graphlib
import itertools
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tools.build_extension import CARRIED

REPOSITORY = Path(__file__).resolve().parent.parent
HOUSE = ("rauca_core", "blender_addon", "pipelines", "benchmarks")
FLOW = ("contract", "geometry", "render", "environment", "detect", "training", "motion", "attack", "study", "report")
BLENDER = {"addon_utils", "blf", "bmesh", "bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils"}


@cache
def sources() -> dict[str, Path]:
    """Every module of the house by its dotted name."""
    found = {}
    for path in itertools.chain.from_iterable((REPOSITORY / top).rglob("*.py") for top in HOUSE):
        parts = path.relative_to(REPOSITORY).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(source: str, package: str) -> Iterator[str]:
    """The dotted names that a module of ``package`` imports; a name from a package counts as its submodule first."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from (a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str))


@cache
def arrows() -> dict[str, frozenset[str]]:
    """What each module imports: modules of the house by dotted name, others by the name of their distribution."""
    return {module: frozenset(_targets(module, path)) for module, path in sources().items()}


def _targets(module: str, path: Path) -> Iterator[str]:
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for name in imported(path.read_text(encoding="utf-8"), package):
        top = name.partition(".")[0]
        # The built extension carries the core inside itself: in a checkout that name stands for nothing.
        if name.startswith("blender_addon.rauca_core"):
            continue
        if top not in HOUSE:
            yield top
            continue
        target = name if name in sources() else name.rpartition(".")[0]
        assert target in sources(), f"{module} imports {name}, which is not there"
        if target != module:
            yield target


def reached(start: str) -> set[str]:
    """All that the modules below ``start`` import, and what that imports in turn."""
    waiting, seen = [m for m in sources() if f"{m}.".startswith(f"{start}.")], set[str]()
    while waiting:
        module = waiting.pop()
        if module not in seen:
            seen.add(module)
            waiting.extend(arrows().get(module, ()))
    return seen


def room(module: str) -> str:
    """The room of a module of ``rauca_core``: its folder's name; the package itself is the public face."""
    return [*module.split("."), "face"][1]


@cache
def map_of_the_house() -> dict[str, set[str]]:
    """CONTRIBUTING's table: the rooms of ``rauca_core``, and which of them each may import."""
    rows = re.findall(
        r"^\| `rauca_core/(\S+?)/?` \|.*\| (.*) \|$", (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.M
    )
    rooms: dict[str, set[str]] = {}
    for name, allowed in rows:
        named = {word.strip(" `") for word in allowed.split(",")}
        rooms[name] = set(rooms) if "all above" in named else named & set(rooms)
    return rooms


def test_no_cycles_among_modules():
    try:
        graphlib.TopologicalSorter({m: a & sources().keys() for m, a in arrows().items()}).prepare()
    except graphlib.CycleError as error:
        pytest.fail("modules import each other: " + " -> ".join(error.args[1]))


def test_the_map_flows_one_way_and_shows_every_room():
    rooms = map_of_the_house()
    assert [name for name in rooms if name in FLOW] == list(FLOW)
    assert set(rooms) == {room(m) for m in sources() if m.startswith("rauca_core.")} - {"version"}


@pytest.mark.parametrize("name", [*FLOW, "runtime", "dataset_tools"])
def test_a_room_imports_what_the_map_allows(name):
    allowed = {*map_of_the_house()[name], name, "version"}
    found = {
        f"{module} -> {target}"
        for module, targets in arrows().items()
        if module.startswith("rauca_core.") and room(module) == name
        for target in targets
        if target.startswith("rauca_core") and room(target) not in allowed
    }
    assert not found


@pytest.mark.parametrize("name", FLOW)
def test_the_map_promises_no_arrow_that_is_not_there(name):
    """Except where it says "all above": that is the order itself."""
    used = {
        room(t) for m, a in arrows().items() if m.startswith(f"rauca_core.{name}.") for t in a if "rauca_core." in t
    }
    promised = map_of_the_house()[name]
    assert promised == set(itertools.takewhile(lambda r: r != name, map_of_the_house())) or promised <= used


def test_nobody_below_looks_at_the_face():
    """It may import everything, so who is imported by it imports it not: ``rauca_core.version`` has the version."""
    assert [m for m, targets in arrows().items() if m.startswith("rauca_core.") and "rauca_core" in targets] == []


def test_the_contract_needs_numpy_alone():
    others = {name for name in reached("rauca_core.contract") if not name.startswith("rauca_core")}
    assert others - set(sys.stdlib_module_names) == {"numpy"}


def test_the_core_knows_nothing_of_blender_nor_of_its_callers():
    assert reached("rauca_core").isdisjoint(BLENDER | {"pipelines", "benchmarks", "blender_addon"})
    assert not [m for m in reached("rauca_core") if m.startswith(HOUSE[1:])]


def test_the_add_on_needs_blender_and_no_torch():
    beside = {m for m in reached("blender_addon") if m.startswith("rauca_core.")}
    assert {room(m) for m in beside} - {"version"} == {"contract", "geometry", "runtime"}
    carried = {f"rauca_core.{name.removesuffix('.py').replace('/', '.')}" for name in CARRIED}
    assert {m for m in beside if room(m) == "runtime"} <= carried | {"rauca_core.runtime"}
    assert not [m for m in reached("blender_addon") if m.startswith(("pipelines", "benchmarks"))]
    others = {m for m in reached("blender_addon") if not m.startswith(HOUSE)} - set(sys.stdlib_module_names)
    assert others - BLENDER == {"numpy", "xatlas", "_cycles"}  # xatlas only where a checkout unwraps a mesh


@pytest.mark.parametrize("part", ["jobs", "scene", "headless"])
def test_what_runs_without_a_window_needs_none(part):
    shown = ("blender_addon.steps", "blender_addon.registration")
    assert not [m for m in reached(f"blender_addon.{part}") if m.startswith(shown)]


def test_programs_do_not_import_benchmarks():
    """`rauca bench` finds them by name, as a wheel has none."""
    assert not [m for m in reached("pipelines") if m.startswith("benchmarks")]


def test_imports_are_found_wherever_they_hide():
    source = """
from __future__ import annotations
import torch.nn
from . import beside
from .. import above as other
from ..room.drawer import Thing
if TYPE_CHECKING:
    from .types import Only
def late():
    import bpy
    importlib.import_module("hidden")
if __name__ == '__main__':
    from .cli import run
"""
    beside = {"house.here.beside", "house.here.types.Only", "house.here.cli.run"}
    above = {"house.above", "house.room.drawer.Thing"}
    assert set(imported(source, "house.here")) == beside | above | {
        "__future__.annotations",
        "torch.nn",
        "bpy",
        "hidden",
    }
