"""One color and mark per paint, the same in every table and plot, told apart with any color vision and in print."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .tables.model import is_normal, is_random

# Okabe and Ito's colors; the second of each pair is for dark pages.
GREY, OCHRE = ("#6b7280", "#a3abb6"), ("#b07d00", "#e0b04a")
PALETTE = (
    ("#0072b2", "#4aa8e0"), ("#d55e00", "#f08a3c"), ("#009e73", "#35c79c"), ("#b0578d", "#df92c0"),
    ("#3f8fc4", "#8fcbf2"), ("#7a6a00", "#d6c84a"),
)  # fmt: skip
COLORS = (GREY, OCHRE, *PALETTE)
MARKS = "os^Dvp*"  # matplotlib's: circle, square, triangle, diamond, ...


@dataclass(frozen=True)
class Style:
    """How a paint is drawn: its color on light and on dark pages, its mark, and its dashes."""

    light: str
    dark: str
    mark: str
    dashes: str = "-"


def paint_styles(paints: Iterable[str]) -> dict[str, Style]:
    """Grey for ``normal``, ochre for ``random``, colors in turn for camouflages, dashed when they come round again."""
    styles: dict[str, Style] = {}
    number = 0
    for paint in paints:
        if is_normal(paint):
            styles[paint] = Style(*GREY, MARKS[0])
        elif is_random(paint):
            styles[paint] = Style(*OCHRE, MARKS[1])
        else:
            turn, place = divmod(number, len(PALETTE))
            styles[paint] = Style(*PALETTE[place], MARKS[2 + number % (len(MARKS) - 2)], ("-", "--", ":")[turn % 3])
            number += 1
    return styles


def themed_color(light: str) -> str:
    """The page's name for a color, which stands for itself where the page defines none."""
    return f"var(--c-{light[1:]}, {light})"


def color_rules() -> str:
    """The style sheet that gives every color its darker-page twin."""
    rules = "".join(f"--c-{light[1:]}: {dark}; " for light, dark in COLORS)
    return f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {rules}}} }}"
