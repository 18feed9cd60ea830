"""The report: one file, everything inside, and nothing that does not belong to the results."""

from __future__ import annotations

import base64
import io
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from rauca_core.contract import Camouflage, RaucaError, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.detect import Detector
from rauca_core.evaluate import ReportNotes, evaluate, reference_images, save_showcase, write_report
from rauca_core.evaluate.frame_choice import chosen_frames
from rauca_core.evaluate.results import FrameRow

VOID = {"meta", "img", "br", "link", "input"}


class Page(HTMLParser):
    """Collects what a browser would load and what a reader would read; notes tags that do not close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loads += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture
def results_path(scene, detectors: list[Detector], tmp_path: Path) -> Path:
    renders = {"normal": reference_images(scene.dataset), "noise <b>": scene.noise}
    evaluate(scene.dataset, renders, detectors, tmp_path / "out", resamples=50)
    return tmp_path / "out" / "results.json"


def test_the_report_is_one_self_contained_file(
    scene, detectors: list[Detector], results_path: Path, tmp_path: Path
) -> None:
    steps = np.linspace(1, 0.2, 40)
    notes = ReportNotes(
        title="A small report",
        white_box=(detectors[0].name,),
        histories={"noise": {"loss": steps.tolist(), "attack": (steps / 2).tolist()}},
        settings={"steps": 40, "smoothness weight": 1e-4},
        commands=["rauca evaluate --paint noise=renders > table.txt"],
        timings_s={"detection": 12.34},
        limitations=["The car is a drawing."],
    )
    out = tmp_path / "report.html"
    write_report(results_path, scene.dataset, [scene.camouflage], out, notes)
    text = out.read_text(encoding="utf-8")
    page = Page(text)
    assert all(load.startswith("data:image/") for load in page.loads)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert "@import" not in text
    assert "url(" not in text
    for words in (
        "A small report",
        "noise <b>",
        "white-box",
        "12.3 s",
        "1e-4".replace("1e-4", "0.0001"),
        "> table.txt",
    ):
        assert words in page.text
    assert "The car is a drawing." in page.text
    images = [decode(load) for load in page.loads]
    # pictures: 2 paints x 5 frames (3 views in the first weather, 2 other weathers); 1 map; 4 curves; 1 loss curve
    kinds = sorted(kind for kind, _ in images)
    assert kinds.count("jpeg") == 2 * 6
    assert kinds.count("png") == 1
    assert kinds.count("svg+xml") == 4 + 1
    for kind, data in images:
        if kind == "svg+xml":
            assert ElementTree.fromstring(data).tag.endswith("svg")
        else:
            Image.open(io.BytesIO(data)).load()


def decode(load: str) -> tuple[str, bytes]:
    match = re.fullmatch(r"data:image/([a-z+]+);base64,([A-Za-z0-9+/=]+)", load)
    assert match
    return match[1], base64.b64decode(match[2], validate=True)


def test_the_numbers_are_those_of_the_results(scene, results_path: Path, tmp_path: Path) -> None:
    write_report(results_path, scene.dataset, [], tmp_path / "a.html")
    first = (tmp_path / "a.html").read_text()
    cells = re.findall(r"<b>(\d+\.\d)</b><small>(\d+\.\d) - (\d+\.\d)</small>", first)
    assert len(cells) == 2 * 3
    assert all(float(low) <= float(ap) <= float(high) for ap, low, high in cells)
    write_report(results_path, scene.dataset, [], tmp_path / "b.html")
    assert (tmp_path / "b.html").read_text() == first  # nothing of the hour or the machine gets in
    assert str(tmp_path) not in first


def test_what_does_not_belong_together_is_refused(
    scene, detectors: list[Detector], results_path: Path, tmp_path: Path
) -> None:
    out = tmp_path / "report.html"
    with pytest.raises(RaucaError, match="white-box detector yolov9 was not evaluated"):
        write_report(results_path, scene.dataset, [], out, ReportNotes(white_box=("yolov9",)))
    other = tmp_path / "other.json"
    save_camouflage(other, Camouflage("x", "van", "0000", 8, "plain"), png_bytes(np.zeros((8, 8, 3), np.uint8)))
    with pytest.raises(RaucaError, match=r"other\.json: made for the UV atlas 0000 of van"):
        write_report(results_path, scene.dataset, [other], out)
    for image in scene.noise.glob("*.png"):
        image.write_bytes(image.read_bytes() + b"changed")
    with pytest.raises(RaucaError, match=r"\.png: missing or changed since it was evaluated"):
        write_report(results_path, scene.dataset, [], out)
    assert not out.exists()


def row(weather: str, azimuth: float, distance: float = 6.0) -> FrameRow:
    return FrameRow(f"{weather}{azimuth}{distance}", weather, azimuth, 10, distance, 45, 0, (0, 0, 9, 9))


@pytest.mark.parametrize("weathers", [1, 2, 3, 9])
@pytest.mark.parametrize("views", [1, 3, 8, 36])
def test_chosen_frames_show_views_and_weathers(weathers: int, views: int) -> None:
    frames = [row(f"w{w}", 360 / views * v, d) for w in range(weathers) for d in (6.0, 9.0) for v in range(views)]
    chosen = [frames[i] for i in chosen_frames(frames)]
    assert len({frame.id for frame in chosen}) == len(chosen) <= 6
    assert len({frame.weather for frame in chosen}) == min(weathers, 4)
    assert len({frame.azimuth_deg for frame in chosen if frame.weather == "w0"}) == min(views, 7 - min(weathers, 4))


def test_the_main_figures_are_files_too(scene, detectors: list[Detector], results_path: Path, tmp_path: Path) -> None:
    written = save_showcase(results_path, scene.dataset, [], detectors[0].name, tmp_path / "pictures")
    assert [path.name for path in written[:2]] == ["grid.jpg", "table.md"]
    with Image.open(written[0]) as sheet:
        assert sheet.height > 2 * 320  # a row per paint
        assert np.asarray(sheet).std() > 20
    table = written[1].read_text().splitlines()
    assert len(table) == 2 + 2
    assert table[2].startswith("| normal | ")
    assert all(line.count("|") == table[0].count("|") for line in table)
