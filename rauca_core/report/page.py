"""A page as data: sections of a few kinds of parts, which templates draw; they escape whatever they are given."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from ..version import __version__
from .figures import Style, color_rules, themed, themed_color
from .table import Place, Table, laid_out
from .writers import TEMPLATES


@dataclass(frozen=True)
class Heading:
    """Inside a section."""

    text: str


@dataclass(frozen=True)
class Note:
    """A paragraph that explains, with links to files beside the page after it."""

    text: str
    links: Sequence[str] = ()


@dataclass(frozen=True)
class Bullets:
    texts: Sequence[str]


@dataclass(frozen=True)
class Commands:
    """What was typed, a line each."""

    lines: Sequence[str]


@dataclass(frozen=True)
class Facts:
    """Names and values in two columns."""

    values: Mapping[str, object]


@dataclass(frozen=True)
class Picture:
    """A JPEG; ``alt`` says what it shows."""

    jpeg: bytes
    alt: str


@dataclass(frozen=True)
class Drawing:
    """An ``<svg>`` element, which takes part in the page's colors."""

    svg: str
    alt: str


@dataclass(frozen=True)
class Figure:
    """A picture over its caption; ``kind`` is ``ring``, ``history`` or nothing, ``numbers`` the table behind it."""

    picture: Picture | Drawing
    caption: str
    kind: str = ""
    numbers: Table | None = None


@dataclass(frozen=True)
class Figures:
    """Figures beside each other: ``plots`` or ``maps``; under a legend where styles are given."""

    kind: str
    figures: Sequence[Figure]
    legend: Mapping[str, Style] = field(default_factory=dict)


@dataclass(frozen=True)
class Grid:
    """Rows of pictures under titles of one line or two; None leaves a hole."""

    titles: Sequence[str]
    rows: Mapping[str, Sequence[Picture | None]]


@dataclass(frozen=True)
class Aside:
    """What others published, marked off from what was measured."""

    title: str
    note: str
    table: Table


Part = Heading | Note | Bullets | Commands | Facts | Figure | Figures | Grid | Aside | Table


@dataclass(frozen=True)
class Section:
    """``note`` says how to read it."""

    title: str
    parts: Sequence[Part]
    note: str = ""


@dataclass(frozen=True)
class Page:
    """A whole page.

    Attributes:
        scope: a sentence below the title.
        lead: what was found, a paragraph each.
        styles: how rows of these names are marked in tables.
        anchors: file of a number's source -> id of the row on the page that tells about it.
    """

    title: str
    scope: str
    lead: Sequence[str]
    sections: Sequence[Section]
    styles: Mapping[str, Style] = field(default_factory=dict)
    anchors: Mapping[str, str] = field(default_factory=dict)

    def html(self) -> str:
        """A document of its own: no script, nothing loaded, no date."""
        template = _environment().get_template("page.html")
        return template.render(page=self, colors=Markup(color_rules()), version=__version__)


@cache
def _environment() -> Environment:
    found = Environment(
        loader=TEMPLATES, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters |= {
        "base64": lambda data: base64.b64encode(data).decode("ascii"),
        "breakable": lambda text: Markup(escape(text).replace("-", "-<wbr>")),
        "drawing": _drawing,
        "kind": lambda part: type(part).__name__,
        "laid_out": laid_out,
        "small": _small_interval,
        "source": _source,
        "themed_color": themed_color,
    }
    return found


def _drawing(drawing: Drawing) -> Markup:
    label = f'<svg role="img" aria-label="{escape(drawing.alt, quote=True)}"'
    return Markup(themed(drawing.svg).replace("<svg", label, 1))


def _small_interval(place: Place) -> str:
    """As printed small below a value: without the zero before the point."""
    low, high = place.interval or ("", "")
    if place.column.kind == "change":
        return f"{low} to {high}"
    return f"{low.removeprefix('0')}–{high.removeprefix('0')}"


def _source(place: Place) -> str:
    """The value with its interval and where it stands, as shown when it is pointed at."""
    if place.cell is None or place.cell.source is None:
        return ""
    source = place.cell.source
    where = f"{source.file}: {' / '.join(key for key in source.keys if key)}"
    ends = place.interval
    return f"{place.shown}, 95 % interval {ends[0]} to {ends[1]}; {where}" if ends else where
