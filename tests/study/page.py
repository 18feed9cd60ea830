"""Pages as a browser and a reader meet them."""

from __future__ import annotations

import base64
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

from PIL import Image

VOID = {"meta", "img", "br", "wbr", "link", "input"}


class Page(HTMLParser):
    """Collects what a browser would load, where links go, and what a reader would read; notes what does not close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.alts: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.cells: list[tuple[str, str, str]] = []  # title, whole text, tag of the rank
        self.text = ""
        self._open: list[str] = []
        self._cell: list[str] | None = None
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        assert not any(name.startswith("on") for name in found)
        self.tags.append(tag)
        self.loads += [value or "" for name, value in attrs if name in ("src", "srcset", "action", "data")]
        if tag == "a":
            self.links.append(found["href"] or "")
        elif tag == "image" or tag == "use":  # inside a drawing
            assert (found.get("href") or found.get("xlink:href") or "").startswith("#")
        if tag == "img":
            self.alts.append(found.get("alt") or "")
        if "svg" in self._open:
            pass  # its ids name glyphs
        elif found.get("id"):
            self.ids.append(found["id"] or "")
        if found.get("title"):
            self._cell = [found["title"] or "", "", ""]
        elif self._cell and tag in ("b", "u"):
            self._cell[2] = tag
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag
        if self._cell and tag in ("a", "span"):
            self.cells.append((self._cell[0], self._cell[1], self._cell[2]))
            self._cell = None

    def handle_data(self, data: str) -> None:
        self.text += data
        if self._cell:
            self._cell[1] += data


def whole_page(path: Path) -> Page:
    """A page that was checked: it loads nothing, runs nothing, tells no folder, and its links lead somewhere."""
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert not {"script", "link", "iframe", "object", "input"} & set(page.tags)
    assert "@import" not in text
    assert "http" not in text.replace("http://www.w3.org", "")
    assert not re.search(r"url\((?!#)", text)
    assert str(path.parent) not in text
    for load in page.loads:
        match = re.fullmatch(r"data:image/jpeg;base64,([A-Za-z0-9+/=]+)", load)
        assert match
        Image.open(io.BytesIO(base64.b64decode(match[1], validate=True))).load()
    assert len(set(page.alts)) == len(page.alts)
    assert all(page.alts)
    for drawing in re.findall(r"<svg role=.*?</svg>", text, re.DOTALL):
        ElementTree.fromstring(drawing)
        assert 'aria-label="' in drawing
    assert len(set(page.ids)) == len(page.ids)
    for link in set(page.links):
        assert link[1:] in page.ids if link.startswith("#") else (path.parent / link).is_file(), link
    return page


def written_elsewhere(folder: Path, code: str, files: Sequence[Path]) -> None:
    """Another process, in a copy of the folder, writes the same bytes: no date, no path, no order of a set gets in."""
    moved = folder / "elsewhere"
    shutil.copytree(folder, moved, ignore=shutil.ignore_patterns("elsewhere", *(file.name for file in files)))
    other = {"PYTHONHASHSEED": "3", "TZ": "Asia/Tokyo", "PYTHONPATH": str(Path(__file__).parents[2])}
    place = moved / files[0].parent.relative_to(folder)
    subprocess.run([sys.executable, "-c", code], cwd=place, env={**os.environ, **other}, check=True, timeout=300)
    for file in files:
        assert (place / file.name).read_bytes() == file.read_bytes(), file.name
