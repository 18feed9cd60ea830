"""The guide's Python and the notebook run as they stand, but for sizes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import rauca_core as rauca
from rauca_core.detect import weights_folder
from rauca_core.study.views import HeldOut
from tests.published import published_weights

DOCS = Path(__file__).resolve().parents[2] / "docs"
SMALLER = {
    r"\(6, 20\)": "(12,)",
    r"locations=2": "locations=1",
    r"size=320": "size=160, samples=2",
    r"size=224, samples=4": "size=160, samples=2",
    r'"azimuths": 4': '"azimuths": 2',
    r"steps=600": "steps=2, map_size=128, samples=3",
    r"frames=48": "frames=2, views=HeldOut(size=160, samples=2)",
    r"range\(100\)": "range(3)",
    r"texture_size=512": "texture_size=128",
    r"views, steps, texture_size = 4, 40, 256": "views, steps, texture_size = 2, 3, 128",
}
"""What the pages ask for, and what the tests do."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all of them run: the data set of the first is there for the second."""
    return tmp_path_factory.mktemp("guide")


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    published_weights("yolov3-tiny", "yolov4-tiny")
    monkeypatch.chdir(folder)
    # A cache of its own, but for the weights, so that the user's keeps nothing of a test.
    kept, ours = weights_folder(), folder / "cache" / "rauca" / "weights"
    if not ours.exists():
        ours.parent.mkdir(parents=True)
        ours.symlink_to(kept, target_is_directory=True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))


def smaller(source: str) -> str:
    for pattern, replacement in SMALLER.items():
        source = re.sub(pattern, replacement, source)
    return source


def run(source: str) -> dict[str, Any]:
    names: dict[str, Any] = {"HeldOut": HeldOut}
    exec(compile(smaller(source), "guide", "exec"), names)
    return names


def blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", (DOCS / "python.md").read_text(), re.S)


@pytest.mark.usefixtures("here")
def test_from_a_data_set_to_a_report(capsys: pytest.CaptureFixture[str]) -> None:
    names = run(blocks()[0])
    assert isinstance(names["study"], rauca.Study)
    rows = names["study"].table()
    assert {"normal", names["paint"].name} <= {
        row["paint"] for row in getattr(rows, "to_dict", lambda _: rows)("records")
    }
    assert "<html" in Path("runs/study/report.html").read_text()[:200]
    assert "yolov4-tiny" in capsys.readouterr().out


@pytest.mark.usefixtures("here")
def test_a_loop_of_ones_own() -> None:
    names = run(blocks()[1])
    assert names["texture"].grad.abs().sum() > 0
    assert names["paint"].texture.shape == (128, 128, 3)


@pytest.mark.usefixtures("here")
def test_the_notebook() -> None:
    cells = json.loads((DOCS / "own-loop.ipynb").read_text())["cells"]
    names = run("\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"))
    assert len(names["losses"]) == names["steps"] == 3
    assert len(names["frames"]) == 2 * 3
    assert names["paint"].name == "mine"
    assert names["picture"](names["images"][0]).size == (160, 160)


def test_every_name_of_the_face_is_there_and_explained() -> None:
    page = (DOCS / "python.md").read_text()
    for name in set(rauca.__all__) - {"__version__", "Paint", "RaucaError"}:
        assert getattr(rauca, name).__doc__
        assert f"`rauca.{name}" in page


def test_the_face_costs_nothing_until_it_is_used() -> None:
    heavy = "import sys, rauca_core; print([m for m in ('torch', 'numpy', 'numba', 'PIL') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True).stdout == "[]\n"
