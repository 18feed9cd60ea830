"""The HTML of the report, section by section; everything is escaped here and every image is inlined."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterable, Mapping
from html import escape
from pathlib import Path

from .results import MEAN, Estimate, Results


def page(title: str, header: str, sections: Iterable[str], footer: str) -> str:
    """A whole document; no script, nothing loaded from elsewhere."""
    css = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style></head>\n<body><main>\n"
        f"<header>{header}</header>\n" + "\n".join(sections) + f"\n<footer>{footer}</footer>\n</main></body></html>\n"
    )


def section(title: str, body: str, note: str = "") -> str:
    paragraph = f'<p class="note">{escape(note)}</p>' if note else ""
    return f"<section><h2>{escape(title)}</h2>{paragraph}{body}</section>"


def image(data: bytes, kind: str, alt: str) -> str:
    """An inlined image; ``kind`` is its MIME type."""
    encoded = base64.b64encode(data).decode("ascii")
    return f'<img src="data:{kind};base64,{encoded}" alt="{escape(alt, quote=True)}">'


def figure(img: str, caption: str) -> str:
    return f"<figure>{img}<figcaption>{escape(caption)}</figcaption></figure>"


def scores_table(results: Results, colours: Mapping[str, str], white_box: Collection[str]) -> str:
    """Paints against detectors, AP in percent over its interval, shaded by value."""
    columns = [*results.detectors, MEAN]
    head = "".join(_column(name, name in white_box) for name in columns)
    rows = "".join(
        f"<tr><th>{_swatch(colours[paint])}{escape(paint)}</th>"
        + "".join(_score(row[name], name == MEAN) for name in columns)
        + "</tr>"
        for paint, row in results.table.items()
    )
    return (
        f'<div class="scroll"><table class="scores"><thead><tr><th></th>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _column(name: str, white_box: bool) -> str:
    mark = '<span class="white-box">white-box</span>' if white_box else ""
    return f"<th{_mean_class(name == MEAN)}>{mark}{escape(name)}</th>"


def _score(estimate: Estimate, is_mean: bool) -> str:
    # pale blue for a detector that sees the car, pale orange for one that does not
    low, high = (253, 219, 199), (209, 229, 240)
    shade = ",".join(str(round(a + (b - a) * estimate.ap)) for a, b in zip(low, high, strict=True))
    return (
        f'<td{_mean_class(is_mean)} style="background:rgb({shade})"><b>{100 * estimate.ap:.1f}</b>'
        f"<small>{100 * estimate.low:.1f} - {100 * estimate.high:.1f}</small></td>"
    )


def _mean_class(is_mean: bool) -> str:
    return ' class="mean"' if is_mean else ""


def _swatch(colour: str) -> str:
    return f'<span class="swatch" style="background:{colour}"></span>'


def legend(colours: Mapping[str, str]) -> str:
    items = " &emsp; ".join(f"{_swatch(colour)}{escape(paint)}" for paint, colour in colours.items())
    return f"<p>{items}</p>"


def picture_grid(columns: Iterable[str], rows: Mapping[str, Iterable[str]]) -> str:
    """Rows of inlined pictures under column titles."""
    head = "".join(f"<th>{escape(title)}</th>" for title in columns)
    body = "".join(
        f"<tr><th>{escape(name)}</th>" + "".join(f"<td>{picture}</td>" for picture in pictures) + "</tr>"
        for name, pictures in rows.items()
    )
    return (
        f'<div class="scroll"><table class="grid"><thead><tr><th></th>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def facts(values: Mapping[str, object]) -> str:
    """A two-column table of names and values."""
    rows = "".join(f"<tr><th>{escape(str(k))}</th><td>{escape(str(v))}</td></tr>" for k, v in values.items())
    return f'<table class="facts">{rows}</table>'


def commands(lines: Iterable[str]) -> str:
    return f"<pre>{escape(chr(10).join(lines))}</pre>"


def paragraphs(texts: Iterable[str]) -> str:
    return "".join(f"<p>{escape(text)}</p>" for text in texts)


def bullets(texts: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in texts) + "</ul>"
