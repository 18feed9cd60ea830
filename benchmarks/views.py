"""``rauca bench views``: composed frames against renders of the same cameras, which lie between the sources.

What is compared is display-referred, in the reference paint: the whole frame, the vehicle, the paint, its edges. Speed
is CPU time on one core, beside what Cycles took for the sources, which are counted in.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract import Dataset, Frame, RaucaError, by_place_and_weather, load_vehicle, read_ledger
from rauca_core.contract.color import linear_to_srgb, srgb_to_linear
from rauca_core.environment import load_exact
from rauca_core.environment.views import Composed, Place, View, compose
from rauca_core.runtime.images import read_image

from .harness import Results, Settings, counted
from .in_blender import Wanted, make_dataset, weathers_of

FULL = Settings(
    vehicles=("sedan", "suv"), finishes=("car_paint", "sticker"), size=320, azimuths=8, elevations="8,20",
    weathers=("sun90-fog0", "sun10-fog0", "sun45-fog50", "heavy-rain-noon", "wet-night"), truths=6, samples=256,
    rounds=3,
)  # fmt: skip
QUICK = FULL.but(
    vehicles=("sedan",), finishes=("own",), size=160, weathers=("sun90-fog0",), truths=2, samples=64, rounds=1
)
FRAMES = 1000  # of a place, over which its sources are shared out
SOLID = 0.99  # coverage from which a pixel is no edge
WANTED = {"paint_db": 34.0, "edge_db": 30.0, "frame_db": 26.0, "frames_per_s": 20.0, "speedup_vs_cycles": 100.0}


def bench(
    out: Path,
    settings: Settings,
    docs: Path | None = None,
    sources: Path | None = None,
    truth: Path | None = None,
) -> Results:
    """Measure; ``sources`` and ``truth``, data sets of the same places, are rendered where they are not given.

    Raises:
        RaucaError: one of the two alone, or sets of other places.
    """
    if (sources is None) != (truth is None):
        raise RaucaError("--sources: goes with --truth, cameras rendered in the same places; give both or neither")
    results = Results("views", settings)
    given = [(Dataset(sources), Dataset(truth))] if sources and truth else list(_rendered(settings, out.parent))
    for rendered, judges in given:
        _measure(results, rendered, judges, settings.rounds)
    _tables(results)
    results.publish(out, docs, "views.md")
    return results


def _rendered(settings: Settings, folder: Path) -> Iterator[tuple[Dataset, Dataset]]:
    """Sources, and truths at other cameras between them, of each vehicle and finish."""
    weathers = weathers_of(settings.weathers)
    for vehicle in settings.vehicles:
        for finish in settings.finishes:
            alike = f"--size {settings.size} --finish {finish} --seed 0"
            around = f"--azimuths {settings.azimuths} --elevations {settings.elevations} --distances 7"
            between = f"--azimuths {settings.truths} --elevations 14 --distances 7.5 --jitter-azimuth 30"
            drawn = f"{between} --jitter-elevation 6 --jitter-distance 0.1 --samples {settings.samples}"
            made = [
                make_dataset(Wanted(f"{name}-{vehicle}", vehicle, weathers, f"{options} {alike}"), folder / "views")
                for name, options in (("sources", around), ("truth", drawn))
            ]
            yield made[0], made[1]


def _measure(results: Results, rendered: Dataset, judges: Dataset, rounds: int) -> None:
    """Rows of every weather and place that both sets hold."""
    for dataset in (rendered, judges):
        dataset.require_rendered("views are composed from, and held against,")
    vehicle = load_vehicle(rendered.vehicle_folder, read_image)
    reference = srgb_to_linear(np.array(rendered.plan.reference_srgb) / 255)
    sources, truths = by_place_and_weather(rendered.frames()), by_place_and_weather(judges.frames())
    spent = {name: entry.seconds for name, entry in read_ledger(rendered.folder).items() if entry.seconds}
    shared = [key for key in sources if key in truths]
    if not shared:
        raise RaucaError(f"{judges.folder}: shows none of the places and weathers of {rendered.folder}")
    with counted("composing", sum(len(truths[key]) for key in shared)) as moved:
        for key in shared:
            frames, (_, weather) = sources[key], key
            place = Place.of(rendered, frames)
            seconds = [spent[frame.id] for frame in frames if frame.id in spent]
            cycles = mean(seconds) if seconds else float("nan")
            views = [View.of(frame) for frame in truths[key]]
            for frame, view in zip(truths[key], views, strict=True):
                made, cpu = _timed(lambda place=place, view=view: compose(place, view, vehicle, reference), rounds)
                results.add(
                    "frames", vehicle=rendered.plan.vehicle_name, finish=rendered.plan.finish, weather=weather,
                    frame=frame.id, sources=len(frames), cpu_ms=cpu, cycles_s=cycles, known=float(made.known.mean()),
                    **compare(made, judges, frame, reference),
                )  # fmt: skip
                moved(frame.id)
            results.add("speed", weather=weather, frames_per_s=_rate(place, views, vehicle, reference))


def _timed(work: Any, rounds: int) -> tuple[Composed, float]:
    """What it makes, and the median CPU milliseconds after a first time."""
    made, laps = work(), []
    for _ in range(rounds):
        began = time.process_time()
        work()
        laps.append(1e3 * (time.process_time() - began))
    return made, median(laps)


def _rate(place: Place, views: list[View], vehicle: Any, reference: NDArray[np.float32]) -> float:
    """Frames a second by two threads."""
    with ThreadPoolExecutor(2) as pool:
        began = time.perf_counter()
        count = len(list(pool.map(lambda view: compose(place, view, vehicle, reference), views * 2)))
        return count / (time.perf_counter() - began)


def compare(made: Composed, judges: Dataset, frame: Frame, reference: NDArray[np.float32]) -> dict[str, float]:
    """PSNR in dB of sRGB values against a rendered frame, the paint's of the gain in grey; boxes differ by px."""
    folder, light = judges.frame_folder(frame.id), load_exact(judges, frame.id)
    vehicle, paint = (read_image(folder / f"{name}.png") / np.float32(255) for name in ("vehicle", "paint"))
    found, true = (linear_to_srgb(image) for image in (made.passes.image_linear, light.A * reference + light.B))
    assert made.passes.A is not None
    stops = np.float32(2.0 ** (frame.exposure_stops - made.frame.exposure_stops))
    gain, true_gain = linear_to_srgb(0.5 * stops * made.passes.A), linear_to_srgb(0.5 * light.A)
    ours, theirs = made.frame.box_xyxy, frame.box_xyxy
    return {
        "frame_db": _psnr(found, true, np.ones_like(vehicle, bool)),
        "vehicle_db": _psnr(found, true, vehicle > 0.5),
        "paint_db": _psnr(gain, true_gain, paint > SOLID),
        "edge_db": _psnr(gain, true_gain, (paint > 0) & (paint <= SOLID)),
        "box_px": float(np.abs(np.subtract(ours, theirs)).max()) if ours and theirs else float(ours != theirs),
    }


def _psnr(found: NDArray[np.float32], true: NDArray[np.float32], where: NDArray[np.bool_]) -> float:
    if not where.any():
        return float("nan")
    return float(-10 * np.log10(max(float(np.mean((found[where] - true[where]) ** 2)), 1e-10)))


def _tables(results: Results) -> None:
    names = ("frame_db", "vehicle_db", "paint_db", "edge_db", "box_px", "known", "cpu_ms")
    kinds = list(dict.fromkeys((r["vehicle"], r["finish"], r["weather"], r["sources"]) for r in results.rows["frames"]))
    for vehicle, finish, weather, sources in kinds:
        rows = results.where("frames", vehicle=vehicle, finish=finish, weather=weather, sources=sources)
        means = {name: float(np.nanmean([row[name] for row in rows])) for name in names}
        cycles, each = rows[0]["cycles_s"], means["cpu_ms"] / 1e3
        speedup = FRAMES * cycles / (FRAMES * each + sources * cycles)
        rate = mean(row["frames_per_s"] for row in results.where("speed", weather=weather))
        results.add(
            "weathers", vehicle=vehicle, finish=finish, weather=weather, sources=sources, **means,
            frames_per_s=rate, speedup_vs_cycles=speedup,
        )  # fmt: skip
    rows = results.rows["weathers"]
    for name, wanted in WANTED.items():
        results.target(f"{name}, worst weather", wanted, min(row[name] for row in rows))
    columns = {
        "vehicle": "{vehicle}", "finish": "{finish}", "weather": "{weather}", "sources": "{sources}",
        "frame dB": "{frame_db:.1f}", "vehicle dB": "{vehicle_db:.1f}", "paint dB": "{paint_db:.1f}",
        "edges dB": "{edge_db:.1f}", "box px": "{box_px:.1f}", "seen": "{known:.3f}", "CPU ms": "{cpu_ms:.0f}",
        "frames/s": "{frames_per_s:.1f}", "x Cycles": "{speedup_vs_cycles:.0f}",
    }  # fmt: skip
    results.table("Composed frames against renders", columns, rows)
    results.target_table()
