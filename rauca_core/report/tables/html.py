"""Tables as HTML: best bold, second underlined, intervals below, every number linked to where it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from ..colors import Style
from ..pages import swatch
from .model import BEST, SECOND, Block, Cell, Column, Table, ranks, shown

_TAGS = {BEST: "b", SECOND: "u"}


class TableWriter:
    """Writes tables of one page.

    Args:
        styles: how each paint is marked; paints without a style get no mark.
        anchors: file of a number's source -> id of the place on the page that tells about it.
    """

    def __init__(self, styles: Mapping[str, Style], anchors: Mapping[str, str]) -> None:
        self._styles = styles
        self._anchors = anchors

    def __call__(self, table: Table) -> str:
        """The table under its caption; blocks side by side where they fit, else below each other."""
        body = self._beside(table) if table.beside else self._stacked(table)
        caption = f"<caption><span>{escape(table.caption)}</span></caption>"
        return f'<div class="scroll"><table class="scores">{caption}{body}</table></div>'

    def _beside(self, table: Table) -> str:
        blocks = table.blocks
        titles = [(block.title, len(table.columns)) for block in blocks]
        head = (_spanning(titles, "block") if any(title for title, _ in titles) else "") + _heads(table, len(blocks))
        names = list(dict.fromkeys(row.name for block in blocks for row in block.rows))
        rows = "".join(self._row(name, [_found(block, name, table) for block in blocks], table) for name in names)
        return f"<thead>{head}</thead><tbody>{rows}</tbody>"

    def _stacked(self, table: Table) -> str:
        parts = [f"<thead>{_heads(table, 1)}</thead>"]
        width = len(table.columns) + 1
        for block in table.blocks:
            title = f'<tr class="block"><th colspan="{width}" scope="rowgroup">{escape(block.title)}</th></tr>'
            rows = "".join(self._row(row.name, [_found(block, row.name, table)], table) for row in block.rows)
            parts.append(f"<tbody>{title}{rows}</tbody>")
        return "".join(parts)

    def _row(self, name: str, blocks: Sequence[Sequence[tuple[Cell | None, int]]], table: Table) -> str:
        mark = swatch(self._styles[name]) if name in self._styles else ""
        opening = _opening(table)
        cells = "".join(
            self._cell(cell, rank, first)
            for block in blocks
            for (cell, rank), first in zip(block, opening, strict=True)
        )
        return f'<tr><th scope="row">{mark}{escape(name)}</th>{cells}</tr>'

    def _cell(self, cell: Cell | None, rank: int, first: bool) -> str:
        classes = [name for name, yes in (("first", first), ("met", cell and cell.white_box)) if yes]
        chosen = f' class="{" ".join(classes)}"' if classes else ""
        if cell is None:
            return f"<td{chosen}>–</td>"
        value = shown(cell.ap)
        value = f"<{_TAGS[rank]}>{value}</{_TAGS[rank]}>" if rank else value
        interval = (
            f"<small>{_short(cell.low)}–{_short(cell.high)}</small>"
            if cell.low is not None and cell.high is not None
            else ""
        )
        return f"<td{chosen}>{self._linked(cell, value)}{interval}</td>"

    def _linked(self, cell: Cell, value: str) -> str:
        if cell.source is None:
            return value
        where = f"{cell.source.file}: {' / '.join(key for key in cell.source.keys if key)}"
        if cell.low is not None and cell.high is not None:
            where = f"{shown(cell.ap)}, 95 % interval {shown(cell.low)} to {shown(cell.high)}; {where}"
        title = f' title="{escape(where, quote=True)}"'
        anchor = self._anchors.get(cell.source.file)
        return f'<a href="#{anchor}"{title}>{value}</a>' if anchor else f"<span{title}>{value}</span>"


def _heads(table: Table, times: int) -> str:
    groups = _spanning(table.groups() * times, "group") if any(title for title, _ in table.groups()) else ""
    opening = _opening(table)
    names = "".join(_head(column, first) for column, first in zip(table.columns, opening, strict=True)) * times
    return f'{groups}<tr class="names"><td></td>{names}</tr>'


def _spanning(spans: Sequence[tuple[str, int]], kind: str) -> str:
    cells = "".join(
        f'<th colspan="{width}" scope="colgroup"><span>{escape(title)}</span></th>'
        if title
        else f'<td colspan="{width}"></td>'
        for title, width in spans
    )
    return f'<tr class="{kind}"><td></td>{cells}</tr>'


def _head(column: Column, first: bool) -> str:
    marks = ("<i>white-box</i>" if column.white_box else "") + ("<i>own, synthetic</i>" if column.own else "")
    chosen = ' class="first"' if first else ""
    return f'<th scope="col"{chosen}>{marks}{escape(column.name).replace("-", "-<wbr>")}</th>'


def _opening(table: Table) -> list[bool]:
    """Which columns open a group."""
    return [opened for _, width in table.groups() for opened in (True, *[False] * (width - 1))]


def _found(block: Block, name: str, table: Table) -> list[tuple[Cell | None, int]]:
    """A paint's cells with their ranks; empty ones when the block lacks it."""
    for row, places in zip(block.rows, ranks(block), strict=True):
        if row.name == name:
            return list(zip(row.cells, places, strict=True))
    return [(None, 0)] * len(table.columns)


def _short(value: float) -> str:
    """Without the zero before the point, as intervals are printed small."""
    return shown(value).removeprefix("0")
