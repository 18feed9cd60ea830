"""The figures as tables, in the terminal and for docs/detectors.md."""

from __future__ import annotations

from benchmarks.tables import Grid, markdown_tables, print_tables

from .results import LARGEST_DIFFERENCE, LARGEST_RATIO, Adapter, Results

WIDTH = 130


def print_report(results: Results) -> None:
    print_tables(_grids(results), WIDTH)


def markdown_report(results: Results) -> str:
    return markdown_tables(_grids(results))


def _grids(results: Results) -> list[Grid]:
    headers = (
        "adapter",
        "reference",
        "compared",
        "images",
        "largest difference",
        "ours, ms",
        "theirs, ms",
        "ratio",
        "step, ms",
    )
    title = f"Adapters beside their references, one core, images: {results.source}"
    grids: list[Grid] = [(title, headers, [_row(adapter) for adapter in results.adapters])]
    hopes = [("difference", f"<= {LARGEST_DIFFERENCE:g}"), ("ratio of the forward pass", f"<= {LARGEST_RATIO:g}")]
    missed = [
        ([a.name for a in results.adapters if not a.agrees], hopes[0]),
        ([a.name for a in results.adapters if not a.fast_enough], hopes[1]),
    ]
    judged = [
        (what, wanted, "met" if not names else f"missed by {', '.join(names)}") for names, (what, wanted) in missed
    ]
    grids.append(("Targets", ("what", "wanted", "found"), judged))
    if results.missing:
        grids.append(("Not measured", ("adapter", "why"), list(results.missing)))
    return grids


def _row(adapter: Adapter) -> tuple[str, ...]:
    times = (adapter.forward_ms, adapter.reference_forward_ms)
    return (
        adapter.name,
        adapter.reference,
        adapter.compared,
        str(adapter.images),
        f"{adapter.max_abs_difference:.1e}",
        *(f"{ms:.1f}" for ms in times),
        f"{adapter.forward_ratio:.2f}",
        f"{adapter.backward_ms:.1f}",
    )
