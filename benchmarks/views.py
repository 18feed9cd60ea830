"""``rauca bench views``: composed frames against renders of the same cameras, which lie between the sources.

What is compared is display-referred, in the reference paint: the whole frame, the vehicle, the paint, its edges. Speed
is CPU time beside that of Cycles for the sources, which are counted in. Where the sources are rendered here that is the
CPU time of Blender's processes, by the share of their wall time that frames took: its start is left out. Of sets that
were there already only the wall seconds of their ledger are known, on however many cores; rows say which.

The paint's light is that of the irradiance textures where the sources have them (`rauca dataset light`), as in drawn
views, and those rendered here get them. Reading it is timed apart: `optimize` does so through taps that it has.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from statistics import mean, median
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract import Dataset, Frame, RaucaError, by_place_and_weather, load_vehicle, read_ledger
from rauca_core.contract.color import linear_to_srgb, srgb_to_linear
from rauca_core.environment import load_exact
from rauca_core.environment.irradiance import Irradiance
from rauca_core.environment.place_light import light_places
from rauca_core.environment.views import Composed, Place, View, compose
from rauca_core.environment.views.drawn import PaintLight
from rauca_core.runtime.images import read_image

from .figures import save_sheet
from .harness import Results, Row, Settings, counted, psnr_db
from .in_blender import Wanted, children_s, make_dataset, weathers_of

FULL = Settings(
    vehicles=("sedan", "suv"), finishes=("car_paint", "sticker"), size=320, azimuths=8, elevations="8,20",
    weathers=("sun90-fog0", "low-sun", "sun30-fog50", "heavy-rain-noon", "wet-night"), truths=6, samples=256,
    rounds=3,
)  # fmt: skip
QUICK = FULL.but(
    vehicles=("sedan",), finishes=("own",), size=160, weathers=("sun90-fog0",), truths=2, samples=64, rounds=1
)
Made = TypeVar("Made")
Pictures = dict[str, NDArray[np.float32]]  # by what they show
FRAMES = 1000  # of a place, over which its sources are shared out
FLIGHT = 8  # frames of the picture of a camera that flies around
SOLID = 0.99  # coverage from which a pixel is no edge
MOST_DB = 100.0  # of what shows no difference
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
    nan = float("nan")
    given = [(Dataset(sources), Dataset(truth), nan)] if sources and truth else _rendered(settings, out.parent)
    shown: dict[str, Pictures] = {}
    for rendered, judges, cpu_s in given:
        shown |= _measure(results, rendered, judges, settings.rounds, cpu_s)
    _tables(results)
    _sheet(results, shown)
    _flight(results, shown)
    results.publish(out, docs, "views.md", width=170)
    return results


def _rendered(settings: Settings, folder: Path) -> Iterator[tuple[Dataset, Dataset, float]]:
    """Sources, and truths at other cameras between them, of each vehicle and finish; CPU seconds a source's render
    took, NaN where some were there already."""
    weathers = weathers_of(settings.weathers)
    for vehicle in settings.vehicles:
        for finish in settings.finishes:
            alike = f"--size {settings.size} --finish {finish} --seed 0"
            around = f"--azimuths {settings.azimuths} --elevations {settings.elevations} --distances 7"
            between = f"--azimuths {settings.truths} --elevations 14 --distances 7.5 --jitter-azimuth 30"
            drawn = f"{between} --jitter-elevation 6 --jitter-distance 0.1 --samples {settings.samples}"
            wanted = [
                Wanted(f"{name}-{vehicle}", vehicle, weathers, f"{options} {alike}")
                for name, options in (("sources", around), ("truth", drawn))
            ]
            there = (folder / "views" / wanted[0].folder_name).exists()
            began, began_s = time.perf_counter(), children_s()
            sources = make_dataset(wanted[0], folder / "views")
            wall, spent = time.perf_counter() - began, children_s() - began_s
            cpu_s = float("nan") if there else _of_frames(sources, spent, wall)
            list(light_places(sources.folder))
            yield sources, make_dataset(wanted[1], folder / "views"), cpu_s


def _of_frames(rendered: Dataset, spent: float, wall: float) -> float:
    """CPU seconds a frame, of a rendering that ``spent`` so many in ``wall`` seconds: its start is no frame's."""
    seconds = [entry.seconds for entry in read_ledger(rendered.folder).values() if entry.seconds]
    return spent * min(sum(seconds) / wall, 1.0) / len(seconds) if seconds else float("nan")


def _measure(results: Results, rendered: Dataset, judges: Dataset, rounds: int, cpu_s: float) -> dict[str, Pictures]:
    """Rows of every weather and place that both sets hold; the pictures of each frame by its label."""
    shown: dict[str, Pictures] = {}
    for dataset in (rendered, judges):
        dataset.require_rendered("views are composed from, and held against,")
    vehicle = load_vehicle(rendered.vehicle_folder, read_image)
    reference = srgb_to_linear(np.array(rendered.plan.reference_srgb) / 255)
    sources, truths = by_place_and_weather(rendered.frames()), by_place_and_weather(judges.frames())
    spent = {name: entry.seconds for name, entry in read_ledger(rendered.folder).items() if entry.seconds}
    shared, paint_light = [key for key in sources if key in truths], PaintLight.of(rendered)
    if not shared:
        raise RaucaError(f"{judges.folder}: shows none of the places and weathers of {rendered.folder}")
    with counted("composing", sum(len(truths[key]) for key in shared)) as moved:
        for key in shared:
            frames, (_, weather) = sources[key], key
            place = Place.of(rendered, frames)
            light = paint_light.read(*key) if paint_light else None
            seconds = [spent[frame.id] for frame in frames if frame.id in spent]
            measured = not np.isnan(cpu_s)
            cycles = cpu_s if measured else (mean(seconds) if seconds else float("nan"))
            views = [View.of(frame) for frame in truths[key]]
            for frame, view in zip(truths[key], views, strict=True):
                gain, gain_ms = _gain(paint_light, light, frame, rounds)
                drawn = partial(compose, place, view, vehicle, reference, gain=gain)
                made, cpu = _timed(drawn, rounds)
                errors, pictures = compare(made, judges, frame, reference)
                row = results.add(
                    "frames", vehicle=rendered.plan.vehicle_name, finish=rendered.plan.finish, weather=weather,
                    frame=frame.id, azimuth_deg=frame.azimuth_deg, sources=len(frames), cpu_ms=cpu, gain_ms=gain_ms,
                    cycles_s=cycles, cycles_clock="CPU" if measured else "wall",
                    light="warped" if gain is None else "texture", known=float(made.known.mean()),
                    **errors,
                )  # fmt: skip
                shown[_label(row)] = pictures
                moved(frame.id)
            results.add(
                "speed", vehicle=rendered.plan.vehicle_name, finish=rendered.plan.finish, weather=weather,
                frames_per_s=_rate(place, views, vehicle, reference),
            )  # fmt: skip
    return shown


def _gain(
    paint_light: PaintLight | None, light: Irradiance | None, frame: Frame, rounds: int
) -> tuple[NDArray[np.float32] | None, float]:
    """The gain of a frame's paint from its texture, and CPU milliseconds with taps built for it; None and 0 without."""
    if paint_light is None or light is None:
        return None, 0.0
    return _timed(partial(paint_light.gain, light, frame.camera_in_vehicle), rounds)


def _timed(work: Callable[[], Made], rounds: int) -> tuple[Made, float]:
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


def _label(row: Row) -> str:
    return f"{row['vehicle']} {row['finish']} {row['frame']}"


def _sheet(results: Results, shown: dict[str, Pictures]) -> None:
    """Add the worst and the median frame by ``frame_db``."""
    rows = sorted(results.rows["frames"], key=lambda row: float(row["frame_db"]))
    chosen = {
        f"{place}, {row['frame_db']:.1f} dB": shown[_label(row)]
        for place, row in (("worst", rows[0]), ("median", rows[len(rows) // 2]))
    }
    results.picture(lambda path: save_sheet(path, chosen), ".jpg", "views.jpg")


def _flight(results: Results, shown: dict[str, Pictures]) -> None:
    """Add the first car's frames of its first weather, as a camera that flies around it sees them."""
    first = results.rows["frames"][0]
    rows = results.where("frames", **{name: first[name] for name in ("vehicle", "finish", "weather")})
    around = sorted(rows, key=lambda row: float(row["azimuth_deg"]))[:FLIGHT]
    chosen = {
        kind: {f"{row['azimuth_deg']:.0f} degrees": shown[_label(row)][kind] for row in around}
        for kind in shown[_label(first)]
    }
    results.picture(lambda path: save_sheet(path, chosen), "-around.jpg", "views-around.jpg")


def compare(
    made: Composed, judges: Dataset, frame: Frame, reference: NDArray[np.float32]
) -> tuple[dict[str, float], Pictures]:
    """PSNR in dB of sRGB values against a rendered frame, the paint's of the gain in grey; boxes differ by px.

    And both as pictures (H, W, 3), with four times their difference.
    """
    folder, light = judges.frame_folder(frame.id), load_exact(judges, frame.id)
    vehicle, paint = (read_image(folder / f"{name}.png") / np.float32(255) for name in ("vehicle", "paint"))
    found, true = (linear_to_srgb(image) for image in (made.passes.image_linear, light.A * reference + light.B))
    assert made.passes.A is not None
    stops = np.float32(2.0 ** (frame.exposure_stops - made.frame.exposure_stops))
    gain, true_gain = linear_to_srgb(0.5 * stops * made.passes.A), linear_to_srgb(0.5 * light.A)
    off, gain_off = (found - true) ** 2, (gain - true_gain) ** 2
    ours, theirs = made.frame.box_xyxy, frame.box_xyxy
    errors = {
        "frame_db": psnr_db(off, MOST_DB),
        "vehicle_db": psnr_db(off[vehicle > 0.5], MOST_DB),
        "paint_db": psnr_db(gain_off[paint > SOLID], MOST_DB),
        "edge_db": psnr_db(gain_off[(paint > 0) & (paint <= SOLID)], MOST_DB),
        "box_px": float(np.abs(np.subtract(ours, theirs)).max()) if ours and theirs else float(ours != theirs),
    }
    return errors, {"composed": found, "rendered": true, "error x 4": np.clip(4 * np.abs(found - true), 0, 1)}


def _mean(values: Sequence[float]) -> float:
    """Of those that are numbers; NaN if none is: a car may show no edge of its paint."""
    known = [value for value in values if not np.isnan(value)]
    return mean(known) if known else float("nan")


def _tables(results: Results) -> None:
    names = ("frame_db", "vehicle_db", "paint_db", "edge_db", "box_px", "known", "cpu_ms", "gain_ms")
    kinds = list(dict.fromkeys((r["vehicle"], r["finish"], r["weather"], r["sources"]) for r in results.rows["frames"]))
    for vehicle, finish, weather, sources in kinds:
        rows = results.where("frames", vehicle=vehicle, finish=finish, weather=weather, sources=sources)
        means = {name: _mean([row[name] for row in rows]) for name in names}
        cycles, each = rows[0]["cycles_s"], means["cpu_ms"] / 1e3
        clocks = {row["cycles_clock"] for row in rows}
        speedup = FRAMES * cycles / (FRAMES * each + sources * cycles)
        rate = mean(
            row["frames_per_s"] for row in results.where("speed", vehicle=vehicle, finish=finish, weather=weather)
        )
        results.add(
            "weathers", vehicle=vehicle, finish=finish, weather=weather, sources=sources, light=rows[0]["light"],
            **means, cycles_s=cycles, cycles_clock="/".join(sorted(clocks)), frames_per_s=rate,
            speedup_vs_cycles=speedup,
        )  # fmt: skip
    rows = results.rows["weathers"]
    for name, wanted in WANTED.items():
        results.target(f"{name}, worst weather", wanted, min(row[name] for row in rows))
    columns = {
        "vehicle": "{vehicle}", "finish": "{finish}", "weather": "{weather}", "sources": "{sources}",
        "frame dB": "{frame_db:.1f}", "vehicle dB": "{vehicle_db:.1f}", "light": "{light}",
        "paint dB": "{paint_db:.1f}", "edges dB": "{edge_db:.1f}", "box px": "{box_px:.1f}", "seen": "{known:.3f}",
        "CPU ms": "{cpu_ms:.0f}", "light, ms": "{gain_ms:.0f}", "Cycles s": "{cycles_s:.1f} {cycles_clock}",
        "frames/s": "{frames_per_s:.1f}", "x Cycles": "{speedup_vs_cycles:.0f}",
    }  # fmt: skip
    results.table("Composed frames against renders", columns, rows)
    results.target_table()
