"""The page in docs/: its words are written by hand, its figures and pictures by the benchmark."""

from __future__ import annotations

from pathlib import Path

from rauca_core.contract import RaucaError
from rauca_core.contract.files import write_bytes


def mark(benchmark: str) -> str:
    """What stands before the figures of a ``rauca bench`` command."""
    return f"<!-- figures: written by rauca bench {benchmark} --docs -->"


BEGIN, END = mark("render"), "<!-- end of figures -->"


def fill_page(page: Path, figures: str, benchmark: str = "render") -> None:
    """Replace what stands between the marks; a page that does not exist is made of the figures alone.

    Args:
        benchmark: the ``rauca bench`` command whose mark the page has.

    Raises:
        RaucaError: the page has lost its marks.
    """
    begins = mark(benchmark)
    text = page.read_text() if page.is_file() else f"{begins}\n{END}\n"
    before, begin, rest = text.partition(begins)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise RaucaError(f"{page}: the marks for the figures are gone; put {begins} and {END} back")
    write_bytes(page, f"{before}{begins}\n\n{figures}\n{END}{after}".encode())
