"""An ablation's tables: in the paper's form, and the averages beside the paper's own."""

from __future__ import annotations

from collections.abc import Sequence

from ..study.ablations.findings import Findings
from ..study.ablations.paired import Scores
from ..study.ablations.verdicts import Verdict
from ..study.contestants import NORMAL, RANDOM
from ..study.families import family_of, in_table_order, is_own
from ..study.results import Estimate
from .tables import PaperTable, Table, paper_tables
from .tables.model import AVERAGE, Block, Cell, Column, Row, Source
from .tables.of_study import weathers_title

FILE = "ablation.json"


def main_table(found: Findings, scores: Scores) -> Table:
    """AP of every row and detector, a block per set of weathers."""
    names = in_table_order(list(scores.detectors))
    columns = [Column(n, family_of(n), is_own(n), n in found.attacked) for n in names]
    blocks = []
    for weathers in scores.weathers:
        rows = []
        for row, title in found.titles.items():
            attacked = row not in (NORMAL, RANDOM)
            cells = [
                _cell(scores.ap(row, [n], [weathers]), weathers, row, n, attacked and n in found.attacked)
                for n in names
            ]
            mean = _cell(scores.ap(row, found.detectors, [weathers]), weathers, row, AVERAGE)
            rows.append(Row(title, (*cells, mean)))
        blocks.append(Block(weathers_title(weathers), tuple(rows)))
    left_out = " but this project's own" if len(found.detectors) < len(names) else ""
    seeds = max(len(paints) for paints in found.paints.values())
    repeats = f", mean of {seeds} optimizations" if seeds > 1 else ""
    caption = (
        f"{found.study.entries[0].category.capitalize()} AP@0.5{repeats}; the average is over all detectors{left_out}."
    )
    return Table(
        f"ablation-{found.experiment.name}", found.experiment.title, caption, (*columns, Column(AVERAGE)), tuple(blocks)
    )


def _cell(estimate: Estimate, weathers: str, row: str, column: str, white_box: bool = False) -> Cell:
    source = Source(FILE, ("scores", weathers, row, column))
    return Cell(estimate.ap, estimate.low, estimate.high, source, white_box)


def paper_table(found: Findings) -> PaperTable | None:
    """The paper's own table of this ablation, if it has one."""
    return next((paper for paper in paper_tables() if paper.beside == found.experiment.paper), None)


def beside_table(found: Findings, scores: Scores, paper: PaperTable) -> Table:
    """Averages of ours and of the paper's rows, side by side."""
    blocks = paper.table.blocks
    names = {NORMAL: "Normal", RANDOM: "Random", **{v.key: v.paper_row for v in found.variants}}
    rows = []
    for row, title in found.titles.items():
        ours = [_cell(scores.ap(row, found.detectors, [w]), w, row, AVERAGE) for w in scores.weathers]
        rows.append(Row(title, (*ours, *(_printed(block, names[row], paper.number) for block in blocks))))
    columns = [
        *(Column(weathers_title(weathers), "measured here") for weathers in scores.weathers),
        *(Column(block.title or "its views", f"the paper's Table {paper.number}") for block in blocks),
    ]
    caption = "AP@0.5 averaged over detectors: ours and the paper's. Compare the order and the gaps, not the digits."
    key = f"beside-{found.experiment.name}"
    return Table(key, "Beside the paper", caption, tuple(columns), (Block("", tuple(rows)),))


def _printed(block: Block, name: str | None, table: int) -> Cell | None:
    """The paper's average in a row of that name; None where it printed none."""
    found = next((row.cells[-1] for row in block.rows if row.name == name), None)
    return None if found is None else Cell(found.ap, source=Source(f"the paper, Table {table}", (str(name), AVERAGE)))


def gap_table(found: Findings, verdicts: Sequence[Verdict]) -> list[tuple[str, ...]]:
    """Lines of what decides the verdicts: claim by, better, worse, gap over all, gaps of parts, outcome."""
    scopes = _scopes(verdicts)
    lines = [
        ("claim of", "lower AP claimed", "higher AP claimed", "gap, all views", *(f"gap, {s}" for s in scopes), "")
    ]
    for verdict in verdicts:
        for one in verdict.comparisons:
            gaps = [shown_gap(one.gap), *(shown_gap(one.by_scope[s]) if s in one.by_scope else "–" for s in scopes)]
            titles = found.titles
            lines.append((verdict.claim.by, titles[one.better], titles[one.worse], *gaps, one.outcome))
    return lines


def shown_gap(gap: Estimate) -> str:
    return f"{gap.ap:+.3f} [{gap.low:+.3f}, {gap.high:+.3f}]"


def _scopes(verdicts: Sequence[Verdict]) -> list[str]:
    return list(dict.fromkeys(s for v in verdicts for one in v.comparisons for s in one.by_scope))
