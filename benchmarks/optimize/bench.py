"""The order of events of ``rauca bench optimize``."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.environment.datasets import Wanted, make, weathers_of
from benchmarks.page import fill_page
from benchmarks.tables import Grid, markdown_tables, print_tables
from pipelines.console import progress_bar
from rauca_core.attack import DetectorEnsemble, StepReport, make_settings
from rauca_core.attack.run import Run
from rauca_core.attack.stopwatch import STAGES
from rauca_core.contract import Dataset, Progress
from rauca_core.contract.files import write_json
from rauca_core.detect import fetch, load_detector
from rauca_core.render import Sampler
from rauca_core.runtime.cpu import keep_large_blocks, threads

from .algorithm2 import Algorithm2Run
from .settings import FULL, QUICK, Settings

OURS, COMPOSED, PUBLISHED = "taps", "algorithm 2, as taps", "algorithm 2"
WANTED_SHARE = 0.15
WIDTH = 140


@dataclass(frozen=True, eq=False)
class Contender:
    """One renderer in the loop, and the steps it took."""

    name: str
    run: Run
    reports: list[StepReport]

    def stage_ms(self, stage: str) -> float:
        return statistics.median(report.stages[stage] for report in self.reports) * 1e3

    @property
    def step_ms(self) -> float:
        return statistics.median(report.seconds for report in self.reports) * 1e3

    @property
    def share(self) -> float:
        """Median over the steps of what is not spent in the detector and its gradient."""
        return statistics.median(1 - report.stages["detector"] / report.seconds for report in self.reports)

    def to_json(self, batch: int) -> dict[str, Any]:
        return {
            **{f"{stage}_ms": round(self.stage_ms(stage), 3) for stage in STAGES},
            "step_ms": round(self.step_ms, 3),
            "non_detector_share": round(self.share, 4),
            "images_per_second": round(batch * 1e3 / self.step_ms, 2),
        }


def bench_optimize(out: Path, quick: bool = False, docs: Path | None = None) -> dict[str, Any]:
    """Time the steps of an optimization by stage, on one thread; write ``out`` (JSON).

    The loop runs with our taps, with Algorithm 2 worked out once as taps, and with Algorithm 2 as published, by turns.

    Args:
        docs: folder whose `optimizer.md` gets the figures anew.

    Raises:
        RaucaError: Blender or the detector's weights are missing.
    """
    settings = QUICK if quick else FULL
    fetch(settings.detector)
    keep_large_blocks()
    dataset = make(_data(settings), out.parent / "optimize")
    with threads(1):
        found = _measure(dataset, settings)
    result = {
        "settings": vars(settings),
        **found[0].to_json(settings.batch),
        "contenders": {contender.name: contender.to_json(settings.batch) for contender in found},
    }
    grids = _tables(found, settings)
    print_tables(grids, WIDTH)
    write_json(out, result)
    if docs is not None:
        fill_page(docs / "optimizer.md", markdown_tables(grids), "optimize")
    return result


def _data(settings: Settings) -> Wanted:
    options = (
        f"--size {settings.size} --locations 1 --azimuths {settings.views} --elevations 12 --distances 7 "
        "--jitter-azimuth 20 --jitter-distance 0.3 --min-visible 0.4 --seed 21"
    )
    return Wanted("optimize", "sedan", weathers_of(settings.weathers), options)


def _measure(dataset: Dataset, settings: Settings) -> list[Contender]:
    ensemble = DetectorEnsemble([load_detector(settings.detector, settings.detector_size)], "car")
    chosen = {"batch": settings.batch, "map_size": settings.map_size, "lr": 0.01, "threads": 1, "start": "plain"}
    ours, composed = (
        Run(dataset, ensemble, make_settings(**chosen, **more))
        for more in ({}, {"sampler": Sampler.UV_TRAVERSAL, "samples": 2, "pixel_filter": "box"})
    )
    published = Algorithm2Run(dataset, ensemble, make_settings(**chosen))
    published.prepare()
    found = [Contender(name, run, []) for name, run in ((OURS, ours), (COMPOSED, composed), (PUBLISHED, published))]
    every = len(found) * (settings.warm_up + settings.rounds * settings.steps)
    with progress_bar("optimizing", resumes=False) as move:
        done = 0
        for number in range(-1, settings.rounds):  # round -1 builds taps, compiles and is not counted
            for contender in found:
                for _ in range(settings.warm_up if number < 0 else settings.steps):
                    report = contender.run.advance()
                    if number >= 0:
                        contender.reports.append(report)
                    done += 1
                    move(Progress(done, every, contender.name))
    for contender in found:
        contender.run.close()
    return found


def _tables(found: Sequence[Contender], settings: Settings) -> list[Grid]:
    rows = [
        (
            c.name, *(f"{c.stage_ms(stage):.1f}" for stage in STAGES), f"{c.step_ms:.0f}", f"{c.share:.1%}",
            f"{settings.batch * 1e3 / c.step_ms:.1f}",
        )
        for c in found
    ]  # fmt: skip
    title = (
        f"Milliseconds of a step by stage: {settings.batch} frames of {settings.size} px, {settings.detector} at "
        f"{settings.detector_size}, UV map of {settings.map_size}, one thread"
    )
    reached = "pass" if found[0].share <= WANTED_SHARE else "FAIL"
    targets = [("share of a step outside the detector", f"<= {WANTED_SHARE:.0%}", f"{found[0].share:.1%}", reached)]
    return [
        (title, ("renderer", *STAGES, "step", "not detector", "images/s"), rows),
        ("Targets", ("what", "wanted", "found", ""), targets),
    ]
