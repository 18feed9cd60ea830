"""Pages point at what exists: links, pictures, modules, the site's navigation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
NOT_PAGES = {"pictures/table.md"}  # of the README, see mkdocs.yml
NAVIGATION = (ROOT / "mkdocs.yml").read_text().partition("\nnav:")[2]


def links(page: Path) -> list[str]:
    """Where a page's links and pictures lead, but for other hosts and places on the page itself."""
    text = re.sub(r"`[^`\n]*`", "", page.read_text())
    found = re.findall(r"\]\(\s*([^)\s#]+)[^)]*\)", text)
    return [target for target in found if not re.match(r"[a-z]+:", target)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    broken = [target for target in links(page) if not (page.parent / target).exists()]
    assert not broken


def test_links_are_found() -> None:
    assert "docs/pictures/before-after.jpg" in links(ROOT / "README.md")
    assert len(links(DOCS / "index.md")) > 10


def test_pages_of_the_site_lead_nowhere_outside() -> None:
    """A link out of docs/ works in the repository and breaks on the site."""
    for page in DOCS.rglob("*.md"):
        for target in links(page):
            assert (page.parent / target).resolve().is_relative_to(DOCS), f"{page.name}: {target}"


def test_every_page_is_in_the_navigation() -> None:
    pages = {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")} - NOT_PAGES
    assert set(re.findall(r"[\w/-]+\.md", NAVIGATION)) == pages


def test_every_public_room_is_in_the_reference() -> None:
    rooms = {path.parent.name for path in (ROOT / "rauca_core").glob("*/__init__.py")}
    assert rooms == {page.stem for page in (DOCS / "reference").glob("*.md")} - {"index"}
    for room in rooms:
        assert f"::: rauca_core.{room}" in (DOCS / "reference" / f"{room}.md").read_text()


def test_the_reference_names_what_is_there() -> None:
    """Each ``::: name`` is a module, or what a module defines; the site's builder stops at any other."""
    for page in (DOCS / "reference").glob("*.md"):
        for name in re.findall(r"^::: ([\w.]+)$", page.read_text(), re.MULTILINE):
            path = ROOT / name.replace(".", "/")
            if path.is_dir() or path.with_suffix(".py").is_file():
                continue
            module = path.parent.with_suffix(".py")
            assert module.is_file(), f"{page.name}: {name}"
            assert re.search(rf"^((def|class) )?{path.name}\b", module.read_text(), re.M), f"{page.name}: {name}"


def _code_of_method_page() -> list[tuple[str, list[str]]]:
    """Paths in docs/method.md, each with the names that follow it."""
    text = (DOCS / "method.md").read_text()
    found = re.findall(r"`([\w/-]+\.(?:py|json))`((?:: `[\w.]+`(?:, `[\w.]+`)*)?)", text)
    return [(path, re.findall(r"`([\w.]+)`", names)) for path, names in found]


@pytest.mark.parametrize(("path", "names"), _code_of_method_page())
def test_method_page_names_code_that_exists(path: str, names: list[str]) -> None:
    file = next((f for f in (ROOT / "rauca_core" / path, ROOT / path) if f.is_file()), None)
    assert file is not None, path
    text = file.read_text()
    for name in names:
        for part in name.split("."):
            assert re.search(rf"(def |class |^){part}\b", text, re.MULTILINE), f"{path}: {name}"


def test_method_page_has_every_equation() -> None:
    text = (DOCS / "method.md").read_text()
    assert set(re.findall(r"Eq\. (\d)(?:, (\d))?", text)) >= {("1", "2"), *((n, "") for n in "345678")}
    assert {"1", "2"} <= set(re.findall(r"Algorithm (\d)", text))


def test_names_hidden_by_a_module_of_the_same_name_are_in_the_reference() -> None:
    """Where a room exports a function that is called like its module, the site would show neither."""
    hidden = []
    for room in (path.parent for path in (ROOT / "rauca_core").glob("*/__init__.py")):
        text = (room / "__init__.py").read_text()
        names = set(re.findall(r"^from \.(\w+) import (?:.*\b)?\1\b", text, re.MULTILINE))
        page = (DOCS / "reference" / f"{room.name}.md").read_text()
        hidden += [(room.name, name) for name in names if f"::: rauca_core.{room.name}.{name}.{name}" not in page]
        assert room.name != "geometry" or "unwrap" in names
    assert not hidden


def test_where_changes_belong_is_where_things_are() -> None:
    """Every path in CONTRIBUTING.md exists; those without a top folder are of rauca_core or the add-on."""
    named = set(re.findall(r"`([\w/.]+/[\w.]*)`", (ROOT / "CONTRIBUTING.md").read_text()))
    assert len(named) > 30
    tops = [ROOT / top for top in (".", "rauca_core", "rauca_core/detect", "rauca_core/render", "blender_addon")]
    built = {"site/", "study/", "naturalness/", "ablations/", "defences/"}
    missing = [path for path in named - built if not any((top / path).exists() for top in tops)]
    assert not missing
