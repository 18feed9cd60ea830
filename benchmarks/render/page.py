"""The page in docs/: its words are written by hand, its figures and pictures by the benchmark."""

from __future__ import annotations

from pathlib import Path

from rauca_core.contract import RaucaError
from rauca_core.contract.files import write_bytes

BEGIN, END = "<!-- figures: written by rauca bench render --docs -->", "<!-- end of figures -->"


def fill_page(page: Path, figures: str) -> None:
    """Replace what stands between the marks; a page that does not exist is made of the figures alone.

    Raises:
        RaucaError: the page has lost its marks.
    """
    text = page.read_text() if page.is_file() else f"{BEGIN}\n{END}\n"
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise RaucaError(f"{page}: the marks for the figures are gone; put {BEGIN} and {END} back")
    write_bytes(page, f"{before}{BEGIN}\n\n{figures}\n{END}{after}".encode())
