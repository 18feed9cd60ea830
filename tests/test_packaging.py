"""What the wheel holds: all that an installed rauca needs, and nothing of a checkout."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from pipelines.cli import EXTRAS, missing
from rauca_core.version import __version__
from tools.build_extension import gather

ROOT = Path(__file__).resolve().parents[1]
NEEDED = (
    "rauca_core/report/templates/page.html",
    "rauca_core/report/templates/parts.html",
    "rauca_core/report/templates/report.css",
    "rauca_core/assets/vehicles/sedan/vehicle.json",
    "rauca_core/assets/weathers/base.json",
    "blender_addon/blender_manifest.toml",
    "blender_addon/languages/de.json",
    "blender_addon/steps/panel.py",
    "pipelines/cli.py",
    "pipelines/make_dataset.py",
)
TOPS = {"rauca_core", "blender_addon", "pipelines"}


def tracked(*folders: str) -> Iterator[str]:
    """Files of git in some folders, as they are called in the wheel."""
    listed = subprocess.run(["git", "ls-files", *folders], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            yield re.sub(r"^assets/", "rauca_core/assets/", name)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], cwd=ROOT, check=True,
        capture_output=True,
    )  # fmt: skip
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as found:
        yield found


def contents(wheel: zipfile.ZipFile) -> set[str]:
    return {name for name in wheel.namelist() if ".dist-info/" not in name}


def test_the_wheel_holds_what_it_needs(wheel: zipfile.ZipFile) -> None:
    assert not set(NEEDED) - contents(wheel)
    here = set(tracked(*TOPS, "assets"))
    assert not here - contents(wheel)


def test_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    assert {name.partition("/")[0] for name in contents(wheel)} == TOPS
    assert not [name for name in contents(wheel) if re.search(r"__pycache__|\.py[co]$|\.nb[ci]$|\.blend1$|~$", name)]
    assert sum(info.file_size for info in wheel.infolist()) < 60e6


def test_the_metadata_names_licence_command_and_extras(wheel: zipfile.ZipFile) -> None:
    info = next(name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")).rpartition("/")[0]
    metadata = wheel.read(f"{info}/METADATA").decode()
    assert "License-Expression: Apache-2.0" in metadata
    assert {"dataset", "optimize", "report"} <= set(re.findall(r"^Provides-Extra: (.+)$", metadata, re.MULTILINE))
    assert "rauca = pipelines.cli:run" in wheel.read(f"{info}/entry_points.txt").decode()
    assert f"{info}/licenses/LICENSE" in wheel.namelist()


def test_a_package_of_an_extra_is_missed_in_one_line() -> None:
    assert "pip install 'rauca[report]'" in missing(ModuleNotFoundError("no", name="matplotlib.figure"))
    with pytest.raises(ModuleNotFoundError):
        missing(ModuleNotFoundError("no", name="rauca_core.typo"))


def test_extras_that_are_named_in_messages_bring_the_package() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for package, extra in EXTRAS.items():
        assert any(re.match(rf"{package.replace('_', '-')}\b", asked) for asked in extras[extra]), package


@pytest.mark.parametrize(("python", "wheels"), [("3.11", ["==5.0.1"]), ("3.12", []), ("3.13", ["<6,>=5.1"])])
def test_every_python_gets_the_blender_that_has_a_wheel_for_it(python: str, wheels: list[str]) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    asked = [Requirement(line) for line in extras["dataset"] if line.startswith("bpy")]
    found = [str(of.specifier) for of in asked if of.marker and of.marker.evaluate({"python_version": python})]
    assert found == wheels


def test_blenders_own_tool_accepts_the_manifest() -> None:
    bpy = pytest.importorskip("bpy")
    scripts = Path(bpy.utils.system_resource("SCRIPTS"))
    tool = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    command = [sys.executable, tool, "validate", ROOT / "blender_addon"]
    checked = subprocess.run(command, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_an_extension_says_what_it_lacks(tmp_path: Path) -> None:
    """Not that ``rauca_core`` is missing, which it carries inside itself and a checkout has beside it."""
    gather(tmp_path / "extension")

    def tried(before: str) -> subprocess.CompletedProcess[str]:
        code = f"import sys\n{before}\nimport extension.core\nprint(extension.core.contract)"
        return subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)

    assert "extension.rauca_core.contract" in tried("").stdout
    last = tried("sys.modules['numpy'] = None").stderr.splitlines()[-1]
    assert last.startswith("ModuleNotFoundError: import of numpy")


def test_there_is_one_version() -> None:
    manifest = tomllib.loads((ROOT / "blender_addon" / "blender_manifest.toml").read_text(encoding="utf-8"))
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert manifest["version"] == __version__
    assert cited
    assert cited[1] == __version__
