"""The HTML of the report, piece by piece; everything is escaped here and every image is inlined."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path

from .colors import Style, color_rules, themed_color

_SHAPES = {
    "o": '<circle cx="14" cy="6" r="3.6"/>',
    "s": '<rect x="10.6" y="2.6" width="6.8" height="6.8"/>',
    "^": '<path d="M14 1.6 18.4 9.6H9.6Z"/>',
    "D": '<path d="M14 1 19 6 14 11 9 6Z"/>',
    "v": '<path d="M14 10.4 18.4 2.4H9.6Z"/>',
    "p": '<path d="M14 1.4 18.4 4.6 16.7 9.8H11.3L9.6 4.6Z"/>',
    "*": '<path d="M14 .6 15.3 4.4H19.3L16.1 6.8 17.3 10.8 14 8.4 10.7 10.8 11.9 6.8 8.7 4.4H12.7Z"/>',
}


def page(title: str, header: str, sections: Iterable[str], footer: str) -> str:
    """A whole document; no script, nothing loaded from elsewhere."""
    css = Path(__file__).with_name("report.css").read_text(encoding="utf-8") + color_rules()
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style></head>\n<body><main>\n"
        f"<header>{header}</header>\n" + "\n".join(sections) + f"\n<footer>{footer}</footer>\n</main></body></html>\n"
    )


def section(title: str, body: str, note: str = "") -> str:
    return f"<section><h2>{escape(title)}</h2>{paragraph(note) if note else ''}{body}</section>"


def paragraph(text: str, kind: str = "note") -> str:
    return f'<p class="{kind}">{escape(text)}</p>'


def image(data: bytes, kind: str, alt: str) -> str:
    """An inlined image; ``kind`` is its MIME type."""
    encoded = base64.b64encode(data).decode("ascii")
    return f'<img src="data:{kind};base64,{encoded}" alt="{escape(alt, quote=True)}">'


def drawing(svg: str, alt: str) -> str:
    """An ``<svg>`` element put into the page, so that it takes part in its colors."""
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(alt, quote=True)}"', 1)


def figure(img: str, caption: str, more: str = "", kind: str = "") -> str:
    """A picture over its caption; ``more`` is HTML that follows the caption."""
    chosen = f' class="{kind}"' if kind else ""
    return f"<figure{chosen}>{img}<figcaption>{escape(caption)}</figcaption>{more}</figure>"


def swatch(style: Style) -> str:
    """A paint's line and mark, as plots draw them."""
    dash = {"--": ' stroke-dasharray="5 3"', ":": ' stroke-dasharray="1.5 2.5"'}.get(style.dashes, "")
    color = themed_color(style.light)
    return (
        f'<svg class="swatch" viewBox="0 0 28 12" aria-hidden="true" style="color:{color}">'
        f'<path d="M0 6H28" stroke="currentColor" stroke-width="2"{dash}/>'
        f'<g fill="currentColor">{_SHAPES[style.mark]}</g></svg>'
    )


def legend(styles: Mapping[str, Style]) -> str:
    items = "".join(f"<span>{swatch(style)}{escape(paint)}</span>" for paint, style in styles.items())
    return f'<p class="legend">{items}</p>'


def picture_grid(columns: Iterable[str], rows: Mapping[str, Iterable[str]]) -> str:
    """Rows of inlined pictures under column titles, whose first line stands out."""
    titles = (escape(title).partition("\n") for title in columns)
    head = "".join(f'<th scope="col"><b>{first}</b>{rest}</th>' for first, _, rest in titles)
    body = "".join(
        f'<tr><th scope="row"><span>{escape(name)}</span></th>'
        + "".join(f"<td>{picture}</td>" for picture in pictures)
        + "</tr>"
        for name, pictures in rows.items()
    )
    return (
        f'<div class="scroll"><table class="grid"><thead><tr><td></td>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def facts(values: Mapping[str, object]) -> str:
    """A two-column table of names and values."""
    rows = "".join(
        f'<tr><th scope="row">{escape(str(k))}</th><td>{escape(str(v))}</td></tr>' for k, v in values.items()
    )
    return f'<table class="facts">{rows}</table>'


def commands(lines: Iterable[str]) -> str:
    return f"<pre>{escape(chr(10).join(lines))}</pre>"


def bullets(texts: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in texts) + "</ul>"
