"""The order of events of ``rauca bench dataset``."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.child import run_child
from benchmarks.page import fill_page
from pipelines.console import progress_bar
from pipelines.going_on import goes_on_by_itself
from rauca_core.contract import Progress
from rauca_core.contract.files import write_json
from rauca_core.runtime.blender import require_bpy

from .plots import save_fog_curve, save_pareto
from .report import markdown_report, print_report
from .results import Results
from .settings import FULL, QUICK, Settings

ROOT = Path(__file__).resolve().parent.parent.parent
PICTURES = Path("pictures") / "datasets"


def bench_dataset(out: Path, quick: bool = False, docs: Path | None = None) -> Results:
    """Measure the default data set; write ``out`` (JSON) and two plots beside it.

    Converged references are kept in a folder beside ``out`` and used again while scene and renderer are the same.

    Args:
        docs: folder whose `datasets.md` gets the figures anew, and its pictures the plots.

    Raises:
        RaucaError: Blender is missing, or died.
    """
    return run_bench(QUICK if quick else FULL, out, docs)


def run_bench(settings: Settings, out: Path, docs: Path | None = None) -> Results:
    """The same, of any extent."""
    with goes_on_by_itself(), progress_bar("data set") as move:
        results = _measure(settings, out.parent / "dataset-references", move)
    print_report(results)
    write_json(out, results.to_json())
    save_pareto(results, out.with_suffix(".svg"))
    save_fog_curve(results, out.with_name(f"{out.stem}-fog.svg"))
    if docs is not None:
        save_pareto(results, docs / PICTURES / "cost-error.svg")
        save_fog_curve(results, docs / PICTURES / "composed-fog.svg")
        fill_page(docs / "datasets.md", markdown_report(results), "dataset")
    return results


def _measure(settings: Settings, references: Path, progress: Callable[[Progress], None]) -> Results:
    require_bpy()
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        source, target = Path(temporary) / "settings.json", Path(temporary) / "found.json"
        source.write_text(json.dumps(settings.to_json()))
        command = [sys.executable, "-m", "benchmarks.dataset.inside", *map(str, (source, references.resolve(), target))]
        run_child("dataset", command, progress, {"PYTHONPATH": str(ROOT)})
        return Results.of(settings, json.loads(target.read_text()))
