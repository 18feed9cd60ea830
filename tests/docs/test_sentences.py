"""README, CONTRIBUTING and the site's pages can be read once: no sentence is longer than 30 words."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LONGEST = 30
NAVIGATION = (ROOT / "mkdocs.yml").read_text().partition("\nnav:")[2]
# Written by programs, and a list of changes.
NOT_PROSE = {"commands.md", "licences.md", "changelog.md"}
ABBREVIATED = r"(?<!\bvs\.)(?<!\be\.g\.)"


def pages() -> list[Path]:
    """README, CONTRIBUTING, and all pages of the site but the reference of functions."""
    named = re.findall(r"(?<![\w/])[\w-]+\.md", NAVIGATION.partition("reference/")[0])
    return [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *(ROOT / "docs" / name for name in named if name not in NOT_PROSE),
    ]


def blocks(text: str) -> Iterator[str]:
    """Paragraphs and items of lists, each on one line; no code, tables, headings or pictures."""
    lines, fenced = list[str](), False
    for line in [*re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL).splitlines(), ""]:
        stripped = line.strip()
        fenced ^= stripped.startswith("```")
        indented = line.startswith("    ") and not lines
        item = re.match(r"([-*]|\d+\.) ", stripped)
        apart = not stripped or item or stripped.startswith(("|", "#", "![", "```"))
        if (apart or fenced) and lines:
            yield " ".join(lines)
            lines = []
        if fenced or indented or (apart and not item):
            continue
        lines.append(re.sub(r"^([-*]|\d+\.|>) +", "", stripped))


def sentences(text: str) -> Iterator[str]:
    """Each sentence, with a link's words for the link; what stands as code is one word."""
    for block in blocks(text):
        plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "CODE", block))
        yield from re.split(rf"(?<=[.!?]){ABBREVIATED}[*)\"]*\s+(?=[\"*(A-Z0-9]|rauca)", plain)


def words(sentence: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def test_sentences_are_told_apart() -> None:
    text = "# No\n\nOne two. `a b c` four:\nfive.\n\n- six\n- [seven eight](x.md), v0.1 nine.\n\n    code\n\n| ten |\n"
    text += "```\nno\n```\nrauca ends."
    assert list(sentences(text)) == ["One two.", "CODE four: five.", "six", "seven eight, v0.1 nine.", "rauca ends."]
    assert [words(sentence) for sentence in sentences(text)] == [2, 3, 1, 4, 2]
    assert len(pages()) > 30


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_no_sentence_is_longer_than_thirty_words(page: Path) -> None:
    long = [f"{words(each)}: {each}" for each in sentences(page.read_text()) if words(each) > LONGEST]
    assert not long, "\n".join(long)


def test_pages_that_use_a_term_lead_to_its_meaning() -> None:
    """What leads through a task has each of these words only with a link to the glossary, which has them all."""
    terms = ("AP@0.5", "white box", "texel", "IoU", "HOTA", "PSNR", "quarantined", "albedo")
    glossary = (ROOT / "docs" / "glossary.md").read_text().lower()
    assert not [term for term in terms if f"**{term}".lower() not in glossary]
    tasks = re.findall(r"[\w-]+\.md", NAVIGATION.partition("  - Results:")[0])
    for name in set(tasks) - NOT_PROSE - {"glossary.md"}:
        text = (ROOT / "docs" / name).read_text()
        used = [term for term in terms if any(term in block for block in blocks(text))]
        assert not used or "(glossary.md" in text, f"{name}: {used}"
