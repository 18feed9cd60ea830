"""Tables of a study and of the paper: what is ranked, what is marked, and that files hold what was measured."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import Camouflage, save_camouflage
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.report.published import paper_tables
from rauca_core.report.study_page import headline
from rauca_core.report.study_tables import curves_of, tables_of
from rauca_core.report.table import BEST, SECOND, Block, Cell, Column, Row, Table, printed
from rauca_core.report.writers import escape_latex, tables_csv, tables_json, tables_latex
from rauca_core.study.detection_cache import DetectionCache
from rauca_core.study.detectors import family_of, in_table_order
from rauca_core.study.recorded import Recorded
from rauca_core.study.results import Estimate, save_results
from rauca_core.study.study import Entry, Study, load_study, save_study
from tests.study.measured import made_up

HOSTILE = "<script>alert(1)</script> & 50%_{x}\\end"
PAINTS = ("normal", "random", "ours")
DETECTORS = ("yolov3-tiny", "frcnn-synth", "detr", "faster-rcnn", "yolox-nano")
SHARED = Path(os.environ.get("RAUCA_SHARED", Path(__file__).parents[3] / "shared"))


def study_at(
    folder: Path,
    conditions: list[tuple[str, str, str]],
    paints: tuple[str, ...] = PAINTS,
    detectors: tuple[str, ...] = DETECTORS,
) -> Study:
    """Written to disk and read again; the last paint was optimized against the first detector and another."""
    camouflage = folder / "camouflage.json"
    made = Camouflage("c", "sedan", "0" * 16, 8, "rauca", {"detector": f"{detectors[0]}+unknown"})
    save_camouflage(camouflage, made, png_bytes(np.zeros((8, 8, 3), np.uint8)))
    entries = []
    for number, (vehicle, weathers, defence) in enumerate(conditions):
        out = folder / str(number)
        found = made_up(number, paints, detectors)
        save_results(out / "results.json", found)
        for name in detectors:
            cache = DetectionCache(out / "detections", name, found.detectors[name], found.settings)
            write_bytes(cache.path, b'{"image": "0", "boxes": [], "scores": [], "names": []}\n')
        category = "boat" if vehicle == "boat" else "car"
        entries.append(Entry(weathers, defence, vehicle, category, found, out, camouflages={paints[-1]: camouflage}))
    save_study(folder / "study.json", "rauca evaluate --out here", entries)
    return load_study(folder)


def ranks(*rows: tuple[str, list[float | None]]) -> list[list[int]]:
    block = Block("", tuple(Row(name, tuple(v if v is None else Cell(v) for v in values)) for name, values in rows))
    columns = tuple(Column(str(place)) for place in range(len(rows[0][1])))
    return Table("", "", "", columns, (block,)).ranks(block)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.1, 0.2, 0.3], [BEST, SECOND, 0]),
        ([0.3, 0.1, 0.1], [SECOND, BEST, BEST]),
        ([0.1, 0.2, 0.2], [BEST, SECOND, SECOND]),
        ([0.1, 0.10004, 0.5], [BEST, BEST, SECOND]),  # print alike
        ([0.1, 0.1, 0.1], [BEST, BEST, BEST]),
        ([0.2, None, 0.1], [SECOND, 0, BEST]),
        ([None, None, 0.1], [0, 0, 0]),
        ([0.1], [0]),  # alone it is not the best
    ],
)
def test_best_and_second(values: list[float | None], expected: list[int]) -> None:
    rows = [("normal", [0.0])] + [(f"paint {i}", [value]) for i, value in enumerate(values)]
    assert ranks(*rows) == [[0], *[[rank] for rank in expected]]
    assert ranks(*rows[::-1]) == [*[[rank] for rank in expected[::-1]], [0]]


def test_families_and_the_order_of_columns() -> None:
    families = {
        "single-stage": ("yolov3-tiny", "ssd-mobilenet-v2", "retinanet-r50", "YOLOX"),
        "two-stage": ("frcnn-synth", "fasterrcnn_mobilenet_v3_large_320_fpn", "dynamic-rcnn", "sparse_rcnn_r50"),
        "transformer": ("detr-synth", "rt-detr", "yolos-tiny"),
        "other": ("mine",),
    }
    for family, names in families.items():
        assert {family_of(name) for name in names} == {family}
    mixed = ["detr-synth", "frcnn-synth", "detr", "faster-rcnn", "yolov3"]
    assert in_table_order(mixed) == ["yolov3", "faster-rcnn", "frcnn-synth", "detr", "detr-synth"]


def test_the_tables_of_a_study(tmp_path: Path) -> None:
    sedan = [("sedan", "seen", "none"), ("sedan", "unseen", "none"), ("sedan", "seen", "lgs")]
    study = study_at(tmp_path, [*sedan, ("boat", "seen", "none")])
    tables = {table.key: table for table in tables_of(study)}
    assert list(tables) == ["detectors-sedan", "detectors-boat", "defences-sedan", "vehicles"]
    main = tables["detectors-sedan"]
    assert [b.title for b in main.blocks] == ["Seen weathers", "Unseen weathers"]
    assert [b.title for b in tables["defences-sedan"].blocks] == ["No defence", "LGS"]
    assert main.groups() == [("Average", 3), ("single-stage", 2), ("two-stage", 2), ("transformer", 1)]
    assert [column.name for column in main.columns if column.own] == ["frcnn-synth"]
    assert [column.name for column in main.columns if column.white_box] == ["yolov3-tiny"]
    met = [(row.name, i) for row in main.blocks[0].rows for i, cell in enumerate(row.cells) if cell and cell.white_box]
    assert met == [("ours", 3)]
    assert [column.name for column in main.columns[:3]] == ["took no part", "attacked", "this project's own"]
    for part, entry in zip(main.blocks, study.entries, strict=False):
        for row in part.rows:
            found = entry.results.table[row.name]
            others, attacked, own = (cell.value for cell in row.cells[:3] if cell)
            assert others == pytest.approx(np.mean([found[n].ap for n in DETECTORS[2:]]), abs=1e-12)
            assert (attacked, own) == (found["yolov3-tiny"].ap, found["frcnn-synth"].ap)  # never averaged together
    vehicles = tables["vehicles"]
    assert [(c.name, c.group) for c in vehicles.columns] == [("sedan", "car"), ("boat", "boat")]
    assert [row.cells[1] is None for row in vehicles.blocks[1].rows] == [True] * 3  # the boat met no unseen weathers

    defended = study_at(tmp_path / "defended", [("sedan", "seen", "lgs"), ("boat", "seen", "lgs")])
    assert [table.key for table in tables_of(defended)] == ["defences-sedan", "defences-boat"]


@pytest.mark.parametrize(
    ("normal", "random", "ours", "sentence"),
    [
        (0.9, 0.5, 0.1, "ours lowers car AP@0.5, mean over 1 detector among the attacked: 0.900 for normal, 0.500"),
        (0.9, 0.1, 0.3, "0.900 for normal, 0.100 for random, 0.300 for ours, no lower than random."),
        (0.5, 0.6, 0.48, "0.480 for ours; the intervals of normal and ours overlap."),
        (0.1, 0.2, 0.3, "ours does not lower car AP@0.5, mean over 1 detector among the attacked: 0.100 for normal"),
    ],
)  # fmt: skip
def test_the_headline_says_what_the_table_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, normal: float, random: float, ours: float, sentence: str
) -> None:
    study = study_at(tmp_path, [("sedan", "seen", "none")], detectors=DETECTORS[:1])
    (entry,) = study.entries
    values = zip(PAINTS, (normal, random, ours), strict=True)
    table = {paint: dict.fromkeys(DETECTORS[:1], Estimate(v, 0.9 * v, 1.1 * v)) for paint, v in values}
    found = replace(entry, results=replace(entry.results, table=table))
    monkeypatch.setattr(Recorded, "mean_over", lambda _, names, paint: table[paint][names[0]])
    (said,) = headline(replace(study, entries=(found,)))
    assert said.startswith("Seen weathers: ours ")
    assert sentence in said


def test_every_number_leads_to_its_place_in_a_file(tmp_path: Path) -> None:
    study = study_at(tmp_path, [("sedan", "seen", "none"), ("sedan", "seen", "pad"), ("boat", "seen", "none")])
    curves = [curve for some in curves_of(study).values() for curve in some]
    assert [curve.key for curve in curves] == ["azimuth-seen"]
    checked = 0
    for table in [*tables_of(study), *curves]:
        for cell in (cell for part in table.blocks for row in part.rows for cell in row.cells if cell):
            assert cell.source
            value = json.loads(cell.source.file.read_text())
            for key in cell.source.keys:
                value = value[int(key)] if isinstance(value, list) else value[key]
            if "ap" in value:
                assert (value["ap"], value["low"], value["high"]) == (cell.value, cell.low, cell.high)
            else:  # an average of these
                numbers = [v["ap"] if isinstance(v, dict) else v for v in value.values()]
                assert min(numbers) <= cell.value <= max(numbers)
            checked += 1
    assert checked > 80


def test_csv_and_json_hold_every_number_in_full(tmp_path: Path) -> None:
    study = study_at(tmp_path, [("sedan", "seen", "none"), ("sedan", "unseen", "none")], ("normal", HOSTILE, 'a,"b"\n'))
    tables = tables_of(study)
    lines = list(csv.DictReader(io.StringIO(tables_csv(tables, tmp_path).decode(), newline="")))
    value = json.loads(tables_json(tables, study.command, {}, tmp_path))
    assert value["command"] == "rauca evaluate --out here"
    stored = [line for table in value["tables"] for line in table["values"]]
    assert len(lines) == len(stored) == 2 * 3 * 8
    ends = ("value", "low", "high")
    for line, other in zip(lines, stored, strict=True):
        assert (line["block"], line["row"], line["column"]) == (other["block"], other["row"], other["column"])
        assert [float(line[end]) for end in ends] == [other[end] for end in ends]
    best = [line for line in lines if line["column"] == "detr" and line["rank"] == "best"]
    assert [float(line["value"]) for line in best] == [
        min(e.results.table[p]["detr"].ap for p in e.results.paints[1:]) for e in study.entries
    ]


# What of LaTeX a table may hold: an escaped sign, a command, braces, or plain text without special signs.
TOKEN = re.compile(r"\\[%&$#_{}\\,]|\\[A-Za-z]+|[{}]|[&~]|[^\\{}&%$#_^~]+")


def checked(latex: str) -> list[list[str]]:
    """Rows of cells of each line of every tabular; fails on what LaTeX would refuse."""
    body = latex[latex.index("\\begin{document}") :]
    depth, environments = 0, []
    for line in body.splitlines():
        line = line.removesuffix("%")  # swallows the end of its line
        assert "".join(TOKEN.findall(line)) == line, line
        depth += len(re.findall(r"(?<!\\)\{", line)) - len(re.findall(r"(?<!\\)\}", line))
        for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", line):
            if kind == "begin":
                environments.append(name)
            else:
                assert environments.pop() == name
    assert depth == 0
    assert environments == []
    rows = []
    for columns, text in re.findall(r"\\begin\{tabular\}\{([lr|]+)\}(.*?)\\end\{tabular\}", body, re.DOTALL):
        width = len(columns.replace("|", ""))
        for line in text.splitlines():
            if not line.endswith("\\\\"):
                assert re.fullmatch(r"(\\(top|mid|bottom)rule|(\\cmidrule\(lr\)\{\d+-\d+\})*)", line), line
                continue
            cells = re.split(r"(?<!\\)&", line.removesuffix("\\\\"))
            spans = [int(n) for cell in cells for n in re.findall(r"\\multicolumn\{(\d+)\}", cell)]
            assert len(cells) - len(spans) + sum(spans) == width, line
            rows.append([cell.strip() for cell in cells])
    return rows


@pytest.mark.parametrize("detectors", [DETECTORS[:1], DETECTORS, tuple(f"{d}{i}" for i in range(4) for d in DETECTORS)])
def test_latex_holds_the_numbers_and_is_well_formed(tmp_path: Path, detectors: tuple[str, ...]) -> None:
    paints = ("normal", "random_1", HOSTILE, "[x]", "日本 ü")
    study = study_at(tmp_path, [("sedan", "seen", "none"), ("sedan", "unseen", "none")], paints, detectors)
    (table,) = tables_of(study)
    latex = tables_latex([table], "rauca evaluate\n\\input{secret}").decode()
    assert latex.splitlines()[0] == "% Written by: rauca evaluate \\input{secret}"
    rows = checked(latex)
    for place, row in enumerate(table.blocks[1].rows):
        found = [line for line in rows if line[0] == escape_latex(row.name)][-1]
        values = found[1:][-len(table.columns) :]
        for cell, value, rank in zip(row.cells, values, table.ranks(table.blocks[1])[place], strict=True):
            assert cell is not None
            form = {BEST: r"\textbf{%s}", SECOND: r"\underline{%s}"}.get(rank, "%s")
            assert value == form % printed(cell.value)
    assert "\\textsuperscript{w}" in latex


def test_the_papers_averages_and_their_oddities() -> None:
    papers = paper_tables()
    ablations = {8: "ablation-renderer", 9: "ablation-dataset", 10: "ablation-beta", 12: "ablation-augmentation"}
    kinds = {3: "detectors", 4: "defences", 7: "vehicles", **ablations}
    assert {paper.number: paper.beside for paper in papers} == kinds
    assert papers[0].odd_averages == [
        "Random, seen-weather: 0.554 printed, 0.597 computed",
        "DTA, unseen-weather: 0.287 printed, 0.334 computed",
    ]
    odd = {paper.number: paper.odd_averages for paper in papers[1:]}
    assert {number: sentences for number, sentences in odd.items() if sentences} == {
        9: ["Base multi-weather Dataset: 0.170 printed, 0.270 computed"]
    }


def test_the_papers_tables_are_as_printed() -> None:
    source = SHARED / "paper" / "rauca_e2e.tex"
    if not source.is_file():
        pytest.skip(f"{source}: the paper's source is not here")
    source_tables = re.findall(r"\\begin\{table\*?\}.*?\\end\{table\*?\}", source.read_text(), re.DOTALL)
    for paper in paper_tables():
        text = source_tables[paper.number - 1].split("\\midrule", 1)[1]
        found = {}
        for line in text.split("\\bottomrule")[0].replace("\\midrule", "").split("\\\\"):
            name, *cells = (cell.strip() for cell in line.split("&"))
            name = name.replace("$\\beta$", "β").replace("WithROA", "With ROA")
            cells = [cell for cell in cells if cell not in ("No", "Yes")]
            found[name] = [(re.findall(r"0\.\d+", cell)[0], "bm" in cell, "underline" in cell) for cell in cells]
        blocks = paper.table.blocks
        width = len(paper.table.columns)
        assert [row.name for row in blocks[0].rows] == [name for name in found if name]
        for number, part in enumerate(blocks):
            for row, places in zip(part.rows, paper.table.ranks(part), strict=True):
                expected = found[row.name][number * width : (number + 1) * width]
                cells = [printed(cell.value) for cell in row.cells if cell]
                assert [float(cell) for cell in cells] == [float(value) for value, _, _ in expected]
                if paper.number != 10:  # which has nothing bold
                    assert [rank == BEST for rank in places] == [bold for _, bold, _ in expected]
                if paper.number in (3, 4):  # others have no underlines
                    assert [rank == SECOND for rank in places] == [underlined for _, _, underlined in expected]
