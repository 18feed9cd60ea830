"""The order of events of ``rauca bench render``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from benchmarks.page import fill_page
from pipelines.console import progress_bar
from rauca_core.contract import Progress, Vehicle
from rauca_core.contract.files import write_json
from rauca_core.runtime.cpu import keep_large_blocks, threads

from .accuracy import reference_check
from .blender_agreement import compare_with_blender
from .contenders import Contender, contenders, ours, rivals
from .coverage import reach
from .measure import measure_scene, warm_up
from .pictures import save_pictures
from .raster import time_raster
from .report import markdown_report, print_report, save_plot
from .results import Results
from .scenes import Car, Scene, prepare_car, prepare_scene
from .settings import FULL, QUICK, Settings
from .speed import levels_step, streamed_ms
from .speedup import measure_speedup
from .vehicles import open_vehicle, painted_all_over
from .views import RINGS

PICTURES = Path("pictures") / "renderer"


def bench_render(
    out: Path,
    vehicle: str | None = None,
    paint_mask: Path | None = None,
    paint_material: str | None = None,
    quick: bool = False,
    blender: bool = True,
    docs: Path | None = None,
) -> Results:
    """Measure the default sedan and, if given, another vehicle; write ``out`` (JSON) and a plot beside it.

    Args:
        vehicle: name, vehicle folder, or an .obj, .glb or .blend file.
        blender: compare with Cycles too.
        docs: folder whose `renderer.md` gets the figures anew, and its pictures the plot and the errors.

    Raises:
        RaucaError: a vehicle that cannot be opened; Embree or Blender is missing.
    """
    vehicles = {"sedan": open_vehicle("sedan")}
    given = open_vehicle(vehicle or "sedan", paint_mask, paint_material)
    vehicles[given.name] = given
    return run_bench(vehicles, QUICK if quick else FULL, out, blender, docs)


def run_bench(
    vehicles: Mapping[str, Vehicle], settings: Settings, out: Path, blender: bool = True, docs: Path | None = None
) -> Results:
    """Measure ``vehicles`` by name; targets are judged on the last."""
    results = Results(settings, main=list(vehicles)[-1])
    keep_large_blocks()
    for name, vehicle in vehicles.items():
        with threads(1):
            scene = _measure_car(name, vehicle, settings, results)
            if name == results.main:
                results.reach = _measure_reach(scene.car, settings)
        if docs is not None and name == results.main:
            save_pictures(scene, docs / PICTURES)
        del scene
        if name == results.main:
            with threads(1):
                _measure_rivals(name, vehicle, settings, results)
        if blender:
            with progress_bar(f"{name}: Cycles", resumes=False) as move:
                results.blender.append(compare_with_blender(name, vehicle, settings, move))
    print_report(results)
    write_json(out, results.to_json())
    save_plot(results, out.with_suffix(".svg"))
    if docs is not None:
        save_plot(results, docs / PICTURES / "speed-error.svg")
        fill_page(docs / "renderer.md", markdown_report(results))
    return results


def _measure_car(name: str, vehicle: Vehicle, settings: Settings, results: Results) -> Scene:
    """Everything but Blender; returns the largest paper scene, for pictures."""
    car = prepare_car(name, vehicle, settings)
    warm_up(car, contenders(settings.samples))
    for ring in RINGS:
        for size in settings.sizes:
            scene = _measure_ring(car, ring, size, settings, results)
            if ring == "paper" and size == max(settings.sizes):
                shown = scene
    return shown


def _measure_rivals(name: str, vehicle: Vehicle, settings: Settings, results: Results) -> None:
    """Algorithms 1 and 2 as they are published: on a car that is textured all over."""
    whole = painted_all_over(vehicle)
    if whole is None:
        return
    results.rival = f"{name}, painted all over"
    car, size = prepare_car(results.rival, whole, settings), max(settings.sizes)
    total = settings.paper_views + len(rivals()) * (settings.repeats + 2)
    with _counted(f"{car.name}: paper ring, {size} px", total) as moved:
        scene = prepare_scene(car, "paper", size, settings, moved)
        results.renderers += measure_scene(scene, rivals(), settings, moved)
        results.speedups[car.name] = measure_speedup(scene, rivals()[-1], settings.steps)


def _measure_ring(car: Car, ring: str, size: int, settings: Settings, results: Results) -> Scene:
    everyone = contenders(settings.samples)
    views = settings.paper_views if ring == "paper" else settings.close_views
    total = 2 * views + len(everyone) * (settings.repeats + 2)
    with _counted(f"{car.name}: {ring} ring, {size} px", total) as moved:
        scene = prepare_scene(car, ring, size, settings, moved)
        results.renderers += measure_scene(scene, everyone, settings, moved)
        results.raster.append(time_raster(scene, settings.repeats, moved))
        if ring == "paper" and size == max(settings.sizes):
            two = next(c for c in everyone if c.name == ours(2))
            _measure_step(scene, two, settings, results)
    return scene


def _measure_reach(car: Car, settings: Settings) -> dict[str, float]:
    everyone = [c for c in contenders(settings.samples) if c.samples <= 8]
    with _counted(f"{car.name}: reach of gradients", settings.reach_views * (len(everyone) + 1)) as moved:
        return reach(car, everyone, settings, moved)


def _measure_step(scene: Scene, two: Contender, settings: Settings, results: Results) -> None:
    """What a step of our 2x2 costs: against Algorithm 2, and from the cache."""
    name = scene.car.name
    view = two.taps(scene.car.vehicle, scene.cameras[0], scene.car.pyramid)
    results.levels[name] = levels_step(scene.car.pyramid, view, settings.repeats)
    results.reference_check_db[name] = reference_check(scene, settings.reference_samples)
    results.speedups[name] = measure_speedup(scene, two, settings.steps)
    results.streamed_ms[name] = streamed_ms(scene, two, settings.repeats)


@contextmanager
def _counted(title: str, total: int) -> Iterator[Callable[[], None]]:
    with progress_bar(title, resumes=False) as move:
        done = 0

        def moved() -> None:
            nonlocal done
            done += 1
            move(Progress(min(done, total), total, ""))

        yield moved
