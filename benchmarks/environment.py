"""``rauca bench environment``: every way to light a vehicle against Cycles; what training costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import mean

import torch

from rauca_core.contract import RaucaError
from rauca_core.contract.towns import TEST, TRAINING
from rauca_core.environment import LightSplitter, PublishedEfe
from rauca_core.environment.frames import LightFrame, LightFrames
from rauca_core.environment.methods import (
    AffineRender,
    Render,
    exact_render,
    plain_render,
    published_render,
    splitter_render,
    transfer_render,
)
from rauca_core.environment.metrics import Error
from rauca_core.environment.place_light import PlaceLight, light_places
from rauca_core.runtime.devices import keep_large_blocks, threads

from .environment_report import TEXTURE, save_curve, save_figure_of_maps, summarize, summarize_maps
from .environment_training import adapt, drawn, splitter_db, time_epochs, train_ours, train_published
from .environment_truth import (
    LIGHT,
    SATURATED,
    Budget,
    Truth,
    displayed,
    find_truths,
    regions,
    render_anew,
    save_textures,
)
from .harness import Results, Settings
from .in_blender import Wanted, make_dataset, weathers_of

CLEAR, LOW, FOG, NIGHT = "sun90-fog0", "sun30-fog0", "sun30-fog90", "sun-90-fog0"
FULL = Settings(  # frames are of the sedan unless another vehicle is named
    size=128,  # of the square frames that extractors see, pixels: small, for the published one's sake
    exact_size=320,  # of the frames on which exact maps are judged; the default of ``rauca dataset make``
    exact_azimuths=8,  # views of a place that irradiance textures are fitted to; the nearest is judged
    samples=8,  # of Cycles per pixel in data sets; the default of ``rauca dataset make``
    seen=(CLEAR, LOW, FOG, NIGHT, "sun30-fog50", "sun-30-fog50"),  # of the preset ``base``: extractors train on them
    unseen=(  # of the preset ``unseen``
        "noon-overcast",
        "morning-broken-clouds",
        "afternoon-haze",
        "ground-fog-at-sunrise",
        "wet-after-shower",
        "wet-night",
    ),
    shown=(CLEAR, LOW, FOG, NIGHT),  # weathers of the figures
    locations=2,  # of the training set; its cameras stand at both ``distances_m``
    azimuths=3,
    distances_m=(5.5, 12.0),  # near and far
    test_azimuths=1,  # cameras of the test set, in another town, at each distance
    uv_size=1024,  # of the UV maps, texels
    reference_samples=128,  # of each of two raw renders that stand for the truth
    budgets=(1, 2, 4, 8, 32),  # samples per pixel of the curve of error against seconds
    ours_epochs=60,  # of training on the sedan; both see the same frames
    published_epochs=8,
    widths=(64, 128, 256, 512, 1024),  # of the published U-Net
    timed_frames=2,  # of the epochs that are timed
    vehicles=("suv", "van", "boat_detailed", "aeroplane"),  # unseen ones, to fine-tune on
    vehicle_locations=3,  # of their training sets
    vehicle_azimuths=3,
    most_epochs=60,  # where waiting for convergence ends
)
QUICK = FULL.but(
    size=96,
    exact_size=160,
    seen=(CLEAR, NIGHT),
    unseen=("noon-overcast",),
    shown=(CLEAR, NIGHT, "noon-overcast"),
    azimuths=2,
    uv_size=512,
    reference_samples=48,
    budgets=(2, 8),
    ours_epochs=15,
    published_epochs=2,
    timed_frames=1,
    vehicles=("suv",),
    vehicle_locations=2,
    vehicle_azimuths=1,
    most_epochs=20,
)

_NAME = "bench environment"
TRAIN_SEED, TEST_SEED = TRAINING[_NAME], TEST[_NAME]  # other streets, other cameras
METHODS = ("none", "transfer", "published", "ours", "exact")
JITTER = "--jitter-azimuth 40 --jitter-elevation 8 --jitter-distance 0.2 --jitter-aim 0.2 --min-visible 0.4"
Method = Callable[[int, LightFrame], Render]


def bench(
    out: Path, settings: Settings, docs: Path | None = None, weights: Path | None = None, maps_only: bool = False
) -> Results:
    """Measure; what Blender renders is kept in a folder beside ``out``. ``maps_only``: no extractor, no budgets.

    Raises:
        RaucaError: Blender or the pre-trained ``weights``, the shipped by default, are missing; ``docs`` and only maps.
    """
    if maps_only and docs is not None:
        raise RaucaError("--docs: the page holds the figures of the whole benchmark; leave out --maps-only")
    keep_large_blocks()
    results = Results("environment", settings)
    with threads(1):
        folder = out.parent / "environment"
        if maps_only:
            measure_maps(results, folder)
            summarize_maps(results)
            results.publish(out)
            return results
        _measure(results, folder, weights)
    summarize(results)
    results.picture(partial(save_curve, results), ".svg", "environment/seconds-error.svg")
    results.publish(out, docs, "environment.md")
    return results


def _measure(results: Results, folder: Path, weights: Path | None) -> None:
    settings = results.settings
    wanted = data_sets(settings)

    def made(*names: str) -> LightFrames:
        return LightFrames([make_dataset(wanted[name], folder).folder for name in names])

    frames = made("train", "test")
    train_on, test_on = ([i for i, p in enumerate(frames.places) if p.dataset == number] for number in (0, 1))
    chosen = [i for i in test_on if frames.places[i].frame.weather.name in settings.seen]
    epochs = {"epochs": settings.ours_epochs}
    ours = train_ours(frames, train_on, chosen, drawn(), "our extractor", **epochs)
    without = train_ours(frames, train_on, chosen, drawn(), "our extractor without W", weighted=False, **epochs)
    published = train_published(frames, train_on, chosen, settings, "the published extractor")
    results.add("training", name="published", **published.to_json())
    results.add("training", name="ours", **ours.to_json())
    tests = LightFrames([frames.datasets[1].folder])
    camouflages = save_textures(tests.vehicle(0), settings.uv_size, folder / f"textures-{settings.uv_size}")
    truths = find_truths(tests, camouflages, settings, folder / "cycles")
    compare(results, "sedan", tests, truths, methods_of(tests, ours.net, published.net))
    defaults, near = measure_maps(results, folder)
    results.figures["epoch_time"] = time_epochs(frames, train_on, settings)
    weigh(results, frames, test_on, (ours.net, without.net))
    measure_curve(results, defaults, near, camouflages, folder / "cycles")
    for vehicle in settings.vehicles:
        results.add("vehicles", **adapt(vehicle, made(vehicle), made(f"{vehicle}-unseen"), settings, weights))
    pictures = partial(save_figure_of_maps, tests, truths, ours.net, settings.shown)
    results.picture(pictures, ".jpg", "environment/maps.jpg")


def measure_maps(results: Results, folder: Path) -> tuple[LightFrames, list[Truth]]:
    """Errors of exact maps, and of the same with the gain of the irradiance texture of their place; what was asked."""
    settings = results.settings
    frames = LightFrames([make_dataset(data_sets(settings)["default"], folder).folder])
    camouflages = save_textures(frames.vehicle(0), settings.uv_size, folder / f"textures-{settings.uv_size}")
    near = find_truths(frames, camouflages, settings, folder / "cycles")
    list(light_places(frames.datasets[0].folder))
    places = PlaceLight(frames.datasets[0])

    def of_texture(i: int, frame: LightFrame) -> Render:
        light = places.light_of(frames.places[i].frame)
        return AffineRender(*(torch.from_numpy(half.transpose(2, 0, 1).copy()) for half in (light.A, light.B)))

    compare(results, "defaults", frames, near, {"exact": lambda i, frame: exact_render(frame), TEXTURE: of_texture})
    return frames, near


def data_sets(settings: Settings) -> dict[str, Wanted]:
    """What is rendered, by name; exact maps are judged on ``default``, other vehicles on ``<name>-unseen``."""
    near, everywhere = settings.distances_m[0], ",".join(f"{d:g}" for d in settings.distances_m)
    seen, unseen, small = settings.seen, settings.unseen, settings.size
    sets = [
        ("train", "sedan", seen, small, settings.locations, settings.azimuths, everywhere, TRAIN_SEED),
        ("test", "sedan", (*seen, *unseen), small, 1, settings.test_azimuths, everywhere, TEST_SEED),
        ("default", "sedan", (*seen, *unseen), settings.exact_size, 1, settings.exact_azimuths, f"{near:g}", TEST_SEED),
    ]
    places, azimuths = settings.vehicle_locations, settings.vehicle_azimuths
    for name in settings.vehicles:
        sets.append((name, name, seen, small, places, azimuths, f"{near * 1.5}", TRAIN_SEED))
        sets.append((f"{name}-unseen", name, unseen, small, 1, 2, f"{near * 1.5}", TEST_SEED))
    found = {}
    for name, vehicle, weathers, size, locations, azimuths, distances, seed in sets:
        options = (
            f"--size {size} --samples {settings.samples} --elevations 12 --locations {locations} --azimuths {azimuths} "
            f"--distances {distances} {JITTER} --seed {seed}"
        )
        found[name] = Wanted(name, vehicle, weathers_of(weathers), options)
    return found


def methods_of(frames: LightFrames, ours: LightSplitter, published: PublishedEfe) -> dict[str, Method]:
    return {
        "none": lambda i, frame: plain_render(frame, frames.render_plain(i)),
        "transfer": lambda i, frame: transfer_render(frame),
        "published": lambda i, frame: published_render(published, frame, frames.render_plain(i)),
        "ours": lambda i, frame: splitter_render(ours, frame),
        "exact": lambda i, frame: exact_render(frame),
    }


def compare(
    results: Results, data: str, frames: LightFrames, truths: Sequence[Truth], methods: Mapping[str, Method]
) -> None:
    """Light every truth's frame by every method: sums of errors by region, and CPU milliseconds per image."""
    for truth in truths:
        frame = frames.get(truth.index)
        where = regions(frames.datasets[0], frames.places[truth.index].frame.id)
        for name, method in methods.items():
            started = time.process_time()
            with torch.no_grad():
                seen = method(truth.index, frame)(truth.albedo)[0]
            spent_ms = 1e3 * (time.process_time() - started)
            case = {"data": data, "method": name, "weather": frame.weather, "texture": truth.texture}
            for region, mask in where.items():
                results.add("errors", **case, region=region, cpu_ms=spent_ms, **vars(truth.error(seen, mask)))


def weigh(
    results: Results, frames: LightFrames, test_on: Sequence[int], nets: tuple[LightSplitter, LightSplitter]
) -> None:
    """The same training with and without W of Eq. 5, near and far; the cut lies halfway."""
    cut = sum(results.settings.distances_m) / 2
    for distance, far in zip(results.settings.distances_m, (False, True), strict=True):
        part = [i for i in test_on if (frames.places[i].frame.distance_m > cut) == far]
        with_w, without_w = (splitter_db(net, frames, part) for net in nets)
        results.add("weighting", distance_m=distance, with_w_db=with_w, without_w_db=without_w)


def measure_curve(
    results: Results, frames: LightFrames, truths: Sequence[Truth], camouflages: Mapping[str, Path], folder: Path
) -> None:
    """The truth's frames at every budget, as maps, once for all textures, and textured: dB and CPU seconds."""
    chosen = [truth for truth in truths if truth.texture == SATURATED]
    ids = {truth.index: frames.places[truth.index].frame.id for truth in chosen}

    def budget(truth: Truth, paint: str, samples: int) -> Budget:
        """Denoised, and of the whole frame: what a data set would pay for it."""
        return Budget(ids[truth.index], paint, samples, 1, True, True)

    budgets = results.settings.budgets
    wanted = [budget(truth, paint, n) for truth in chosen for n in budgets for paint in (LIGHT, SATURATED)]
    rendered = render_anew(frames.datasets[0], camouflages, wanted, folder)
    for weather in dict.fromkeys(frames.get(i).weather for i in ids):
        some = [truth for truth in chosen if frames.get(truth.index).weather == weather]
        for samples in budgets:
            inside, edges, cars = Error(), Error(), Error()
            lights = [rendered[budget(truth, LIGHT, samples)] for truth in some]
            textured = [rendered[budget(truth, SATURATED, samples)] for truth in some]
            for truth, light, car in zip(some, lights, textured, strict=True):
                where = regions(frames.datasets[0], ids[truth.index])
                A, B = (torch.from_numpy(light[name].transpose(2, 0, 1).copy()) for name in ("A", "B"))
                seen = AffineRender(A, B)(truth.albedo)[0]
                inside += truth.error(seen, where["inside"])
                edges += truth.error(seen, where["edge"])
                cars += truth.error(displayed(car["image"]), where["inside"])
            results.add(
                "curve", weather=weather, samples=samples, maps_db=inside.psnr_db, maps_edge_db=edges.psnr_db,
                render_db=cars.psnr_db, maps_s=mean(float(light["seconds"]) for light in lights),
                render_s=mean(float(car["seconds"]) for car in textured),
            )  # fmt: skip
