"""The run as tables, in the terminal or as Markdown."""

from __future__ import annotations

from benchmarks.tables import Grid, Rows, markdown_tables, print_tables

from .plots import METHODS, note
from .results import Entry, Results
from .settings import KINDS
from .targets import judge

WIDTH = 170  # what the widest table needs
KIND_HEADERS = tuple(header for kind in KINDS for header in (f"{kind}, dB", "linear", "paint", "CPU s"))


def print_report(results: Results) -> None:
    """Print every table."""
    print_tables(tables(results), WIDTH)


def markdown_report(results: Results) -> str:
    """Every table as Markdown."""
    return markdown_tables(tables(results))


def tables(results: Results) -> list[Grid]:
    """(title, headers, rows) of all that was found."""
    targets: Rows = [
        (t.what, f"≥ {t.wanted:g} {t.unit}", f"{t.found:.4g}", "pass" if t.passed else "FAIL") for t in judge(results)
    ]
    sets: Rows = [
        (
            row.preset, str(row.view), str(row.frames), f"{row.ours:.1f}", f"{row.ours / row.frames:.3f}",
            f"{row.naive:.1f}", ", ".join(f"{k} {n}" for k, n in row.naive_samples.items()), f"{row.speedup:.1f}",
        )
        for row in results.sets
    ]  # fmt: skip
    set_headers = ("preset", "view", "frames", "ours, CPU s", "per frame", "naive, CPU s", "its samples", "times")
    fogs: Rows = [
        (p.light, f"{p.fog_density:g}", f"{p.extinction:.4f}", *(f"{getattr(p, f'{m}_db'):.1f}" for m in METHODS))
        for p in results.fog_curve
    ]
    fog_headers = ("light", "density", "extinction, 1/m", *(f"{label}, dB" for label in METHODS.values()))
    return [
        ("Targets", ("what", "wanted", "found", ""), targets),
        ("Error and cost of a render, and of the light maps that serve every color", ("what", *KIND_HEADERS),
         _sweep_rows(results)),
        ("Whole sets in nine colors, of one view", set_headers, sets),
        ("Composed fog", fog_headers, fogs),
    ]  # fmt: skip


def _sweep_rows(results: Results) -> Rows:
    names = dict.fromkeys(_name(entry) for entry in results.entries)
    rows = []
    for name in names:
        row = [name]
        for kind in KINDS:
            row += next((_cells(e) for e in results.of_kind(kind) if _name(e) == name), ["", "", "", ""])
        rows.append(tuple(row))
    return rows


def _name(entry: Entry) -> str:
    """Says in words what a variant is."""
    if entry.axis in ("samples", "raw"):
        return f"{entry.what}, {note(entry)} samples{'' if entry.denoise else ', raw'}"
    words = {"adaptive": f"adaptive, noise {note(entry)}", "fog": f"fog {note(entry)}"}
    return f"{entry.what}, {words.get(entry.axis, note(entry))}"


def _cells(entry: Entry) -> list[str]:
    return [
        f"{entry.psnr_db:.1f}", f"{entry.linear_psnr_db:.1f}", f"{entry.paint_psnr_db:.1f}", f"{entry.cpu_seconds:.2f}"
    ]  # fmt: skip
