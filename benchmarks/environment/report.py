"""The run as tables, in the terminal or as Markdown, and what it was meant to reach. Printed, never asserted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.tables import Grid, markdown_tables, print_tables

from .results import Results
from .settings import CLEAR, FOG, NIGHT

WIDTH = 120


@dataclass(frozen=True)
class Target:
    """``found`` passes if it is at least, or with ``most`` at most, ``wanted``."""

    what: str
    wanted: float
    found: float
    most: bool = False

    @property
    def passed(self) -> bool:
        return self.found <= self.wanted if self.most else self.found >= self.wanted


def judge(results: Results) -> list[Target]:
    """All targets that this run's extent allows to judge."""
    rows = [*_exact_targets(results), *_extractor_targets(results)]
    for vehicle in results.vehicles:
        rows.append(
            Target(
                f"{vehicle.vehicle}: epochs pre-trained over from scratch, the paper's criterion",
                0.2,
                vehicle.epochs_pretrained / vehicle.epochs_scratch,
                most=True,
            )
        )
        if vehicle.near_scratch and vehicle.near_pretrained is not None:
            ratio = vehicle.near_pretrained / vehicle.near_scratch
            rows.append(Target(f"{vehicle.vehicle}: the same, to 5 % of the error from scratch", 0.2, ratio, most=True))
        rows.append(Target(f"{vehicle.vehicle}: fine-tuned, unseen weather, dB", 28, vehicle.after_db))
    return rows


def _exact_targets(results: Results) -> Iterator[Target]:
    weathers = results.exact.weathers()
    inside = {w: results.inside_db(w) for w in weathers}
    for weather, wanted in ((CLEAR, 40), (FOG, 40), (NIGHT, 38)):
        if weather in inside:
            yield Target(f"exact maps inside the paint, {weather}, dB", wanted, inside[weather])
    yield Target("exact maps inside the paint, worst weather, dB", 35, min(inside.values()))
    yield Target(f"exact maps on edges, {CLEAR}, dB", 36, results.edge_db(CLEAR))
    yield Target("exact maps on edges, worst weather, dB", 32, min(results.edge_db(w) for w in weathers))
    gaps = [_gap(results, weather) for weather in weathers]
    if len(results.settings.budgets) > 1:
        yield Target("exact maps over the car itself at equal time, worst weather, dB", 0, min(gaps))


def _gap(results: Results, weather: str) -> float:
    """Maps' PSNR less that of rendering the car, at the time of the maps' largest budget that both curves reach."""
    rows = sorted((p for p in results.curve if p.weather == weather), key=lambda p: p.samples)
    seconds, db = [np.log(p.render_s) for p in rows], [p.render_db for p in rows]
    return min(p.maps_db - float(np.interp(np.log(p.maps_s), seconds, db)) for p in rows)


def _extractor_targets(results: Results) -> Iterator[Target]:
    found = results.comparison
    if {"ours", "published"} <= set(found.methods()):
        yield Target("our MSE over the published", 0.5, found.find("ours").mse / found.find("published").mse, most=True)
        ratio = found.median_ms("ours") / found.median_ms("published")
        yield Target("our time over the published", 0.25, ratio, most=True)
    counts = results.to_json()["parameters"]
    yield Target("our parameters over the published", 0.25, counts["ours"] / counts["published"], most=True)
    times = results.epochs
    yield Target("epoch, base over final, both with our renderer", 13, times.base / times.final)
    yield Target("epoch, base over final, base rendering as published", 13, times.base_published / times.final)
    yield Target("epoch, base over ours", 20, results.epochs.base / results.epochs.ours)


def tables(results: Results) -> list[Grid]:
    """Every table."""
    return [
        _methods(results),
        _weathers(results),
        _textures(results),
        _budgets(results),
        _training(results),
        _vehicles(results),
        _weighting(results),
        _targets(results),
    ]


def print_report(results: Results) -> None:
    """Print every table."""
    print_tables(tables(results), WIDTH)


def markdown_report(results: Results) -> str:
    """The same as Markdown tables."""
    return markdown_tables(tables(results), "**{}**")


def _methods(results: Results) -> Grid:
    found, rows = results.comparison, []
    for name in found.methods():
        all_, seen, unseen = (found.find(name, w) for w in ((), results.settings.seen, results.settings.unseen))
        figures = (f"{all_.psnr_db:.2f}", f"{seen.psnr_db:.2f}", f"{unseen.psnr_db:.2f}", f"{all_.mse:.5f}")
        rows.append((name, *figures, f"{all_.mae:.4f}", f"{all_.bce:.4f}", f"{found.median_ms(name):.1f}"))
    headers = ("method", "PSNR, dB", "seen weather", "unseen", "MSE", "MAE", "BCE", "CPU ms per image")
    return "Textures never seen, against Cycles, on the paint", headers, rows


def _weathers(results: Results) -> Grid:
    found = results.comparison
    rows = []
    for weather in found.weathers():
        figures = (f"{found.find(name, [weather]).psnr_db:.1f}" for name in found.methods())
        rows.append((weather, *figures, f"{results.inside_db(weather):.1f}", f"{results.edge_db(weather):.1f}"))
    return (
        "PSNR by weather, dB",
        ("weather", *found.methods(), f"exact at {results.settings.exact_size} px, inside", "edges"),
        rows,
    )


def _textures(results: Results) -> Grid:
    found = results.comparison
    names = list(dict.fromkeys(t for _, _, t, _ in found.errors))
    rows = [(t, *(f"{found.find(m, texture=t).psnr_db:.1f}" for m in found.methods())) for t in names]
    return "PSNR by texture, dB", ("texture", *found.methods()), rows


def _budgets(results: Results) -> Grid:
    """Exact maps at every budget, edges after the stroke: what more samples would give."""
    found = {(p.weather, p.samples): p for p in results.curve}
    rows = []
    for samples in dict.fromkeys(p.samples for p in results.curve):
        points = [found[w, samples] for w in results.exact.weathers()]
        seconds = f"{np.mean([p.maps_s for p in points]):.1f}, {np.mean([p.render_s for p in points]):.1f}"
        rows.append((str(samples), seconds, *(f"{p.maps_db:.1f} / {p.maps_edge_db:.1f}" for p in points)))
    headers = ("samples", "CPU s, maps and car", *results.exact.weathers())
    return f"Exact maps by budget, {results.settings.exact_size} px, dB inside / on edges", headers, rows


def _training(results: Results) -> Grid:
    times = results.epochs
    rows = []
    for name, trained, loops in (
        (
            "published",
            results.published,
            f"base {times.base:.2f} ({times.base_published:.0f} with every face tested), final {times.final:.2f}",
        ),
        ("ours", results.ours, f"{times.ours:.2f}"),
    ):
        found = trained.to_json()
        counted = (f"{found['parameters']:,}", str(found["epochs"]), f"{found['cpu_seconds']:.0f}", loops)
        rows.append((name, *counted))
    headers = ("extractor", "parameters", "epochs trained", "CPU s in all", f"CPU s per epoch of {times.frames} frames")
    return "Training on the same frames", headers, rows


def _vehicles(results: Results) -> Grid:
    never = f"over {results.settings.most_epochs}"
    rows = [
        (
            v.vehicle,
            str(v.epochs_scratch),
            str(v.epochs_pretrained),
            str(v.near_scratch),
            never if v.near_pretrained is None else str(v.near_pretrained),
            never if v.epochs_matched is None else str(v.epochs_matched),
            f"{v.mae_scratch:.4f}",
            f"{v.mae_pretrained:.4f}",
            f"{v.before_db:.1f}",
            f"{v.after_db:.1f}",
        )
        for v in results.vehicles
    ]
    headers = (
        "vehicle", "epochs by the paper's criterion, from scratch", "pre-trained",
        "epochs to within 5 % of the error from scratch, from scratch", "pre-trained",
        "from scratch to the pre-trained's first converged error", "MAE from scratch", "pre-trained",
        "unseen weather before, dB", "fine-tuned, dB",
    )  # fmt: skip
    return "Unseen vehicles: epochs from scratch and from pre-trained weights", headers, rows


def _weighting(results: Results) -> Grid:
    rows = [(d, f"{r['with_w_db']:.2f}", f"{r['without_w_db']:.2f}") for d, r in results.weighting.to_json().items()]
    return "W of Eq. 5, PSNR by distance, dB", ("distance", "with W", "without"), rows


def _targets(results: Results) -> Grid:
    rows = [
        (t.what, f"{'<=' if t.most else '>='} {t.wanted:g}", f"{t.found:.3g}", "yes" if t.passed else "no")
        for t in judge(results)
    ]
    return "Targets", ("what", "wanted", "found", "reached"), rows
