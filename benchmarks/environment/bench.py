"""The order of events of ``rauca bench environment``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import fill_page
from rauca_core.contract.files import write_json
from rauca_core.environment import LightSplitter, PublishedEfe
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import exact_render
from rauca_core.runtime.cpu import keep_large_blocks, threads

from .compare import compare, methods_of
from .curve import measure_curve
from .datasets import default_data, held_out_data, make, sedan_data
from .figure import save_curve, save_figure
from .report import markdown_report, print_report
from .results import Results
from .settings import FULL, QUICK, Settings
from .textures import save_textures
from .trainings import drawn, time_epochs, train_ours, train_published
from .truth import find_truths
from .vehicles import adapt
from .weighting import weigh

PICTURES = Path("pictures") / "environment"


def bench_environment(out: Path, quick: bool = False, docs: Path | None = None, weights: Path | None = None) -> Results:
    """Measure every way to light a vehicle; write ``out`` (JSON) and the figures beside it.

    Data sets and Cycles' renders are kept in a folder beside ``out`` and read again by the next run.

    Args:
        docs: folder whose `environment.md` gets the figures anew.
        weights: pre-trained ones; the shipped by default.

    Raises:
        RaucaError: Blender or the weights are missing.
    """
    return run_bench(QUICK if quick else FULL, out, docs, weights)


def run_bench(settings: Settings, out: Path, docs: Path | None = None, weights: Path | None = None) -> Results:
    """Measure to the extent of ``settings``."""
    keep_large_blocks()
    folder = out.parent / "environment"
    with threads(1):
        results = _measure(settings, folder, out, docs, weights)
    print_report(results)
    write_json(out, results.to_json())
    save_curve(results.curve, settings.shown, out.with_suffix(".svg"))
    if docs is not None:
        save_curve(results.curve, settings.shown, docs / PICTURES / "seconds-error.svg")
        fill_page(docs / "environment.md", markdown_report(results), "environment")
    return results


def _measure(settings: Settings, folder: Path, out: Path, docs: Path | None, weights: Path | None) -> Results:
    # One list of frames: the first data set to train on, the second to test on.
    frames = LightFrames([make(wanted, folder).folder for wanted in (sedan_data(settings), held_out_data(settings))])
    train_on, test_on = (_of(frames, number) for number in (0, 1))
    chosen = [i for i in test_on if frames.places[i].frame.weather.name in settings.seen]
    ours = train_ours(frames, train_on, chosen, drawn(), "our extractor", epochs=settings.ours_epochs)
    without = train_ours(
        frames, train_on, chosen, drawn(), "our extractor without W", epochs=settings.ours_epochs, weighted=False
    )
    published = train_published(frames, train_on, chosen, settings, "the published extractor")
    assert isinstance(ours.net, LightSplitter)
    assert isinstance(without.net, LightSplitter)
    assert isinstance(published.net, PublishedEfe)
    tests = LightFrames([frames.datasets[1].folder])
    camouflages = save_textures(tests.vehicle(0), settings.uv_size, folder / f"textures-{settings.uv_size}")
    truths = find_truths(tests, camouflages, settings, folder / "cycles")
    defaults = LightFrames([make(default_data(settings), folder).folder])
    near = find_truths(defaults, camouflages, settings, folder / "cycles")
    results = Results(
        settings,
        compare(tests, truths, methods_of(tests, ours.net, published.net)),
        compare(defaults, near, {"exact": lambda i, frame: exact_render(frame)}),
        ours,
        published,
        time_epochs(frames, train_on, settings),
        weigh(frames, test_on, (ours.net, without.net), settings),
        measure_curve(defaults, near, camouflages, settings, folder / "cycles"),
        [adapt(vehicle, settings, folder, weights) for vehicle in settings.vehicles],
    )
    for path in [out.with_suffix(".jpg"), *([docs / PICTURES / "maps.jpg"] if docs else [])]:
        save_figure(tests, truths, ours.net, settings.shown, path)
    return results


def _of(frames: LightFrames, dataset: int) -> Sequence[int]:
    return [i for i, place in enumerate(frames.places) if place.dataset == dataset]
