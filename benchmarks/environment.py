"""Every way to light a vehicle against Cycles; training times; what pre-training saves: ``rauca bench environment``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean, median

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from rauca_core.environment import LightSplitter, PublishedEfe
from rauca_core.environment.estimate import estimate
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
from rauca_core.environment.metrics import Error, total
from rauca_core.render import linear_to_srgb
from rauca_core.runtime.cpu import keep_large_blocks, threads

from .environment_training import adapt, drawn, splitter_db, time_epochs, train_ours, train_published
from .environment_truth import LIGHT, Budget, Truth, displayed, find_truths, regions, render_anew, save_textures
from .harness import Line, Panel, Results, Row, Settings, save_figure
from .in_blender import Wanted, make_dataset, weathers_of

CLEAR, LOW, FOG, NIGHT = "sun90-fog0", "sun30-fog0", "sun30-fog90", "sun-90-fog0"
FULL = Settings(  # frames are of the sedan unless another vehicle is named
    size=128,  # of the square frames that extractors see, pixels: small, for the published one's sake
    exact_size=320,  # of the frames on which exact maps are judged; the default of ``rauca dataset make``
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

METHODS = ("none", "transfer", "published", "ours", "exact")
TRAIN_SEED, TEST_SEED = 11, 12  # other streets, other cameras
JITTER = "--jitter-azimuth 40 --jitter-elevation 8 --jitter-distance 0.2 --jitter-aim 0.2 --min-visible 0.4"
SATURATED = "saturated"  # the texture of the figures
PICTURES = Path("pictures") / "environment"
Method = Callable[[int, LightFrame], Render]


def bench(out: Path, settings: Settings, docs: Path | None = None, weights: Path | None = None) -> Results:
    """Measure every way to light a vehicle; write ``out`` (JSON) and the figures beside it.

    Data sets and Cycles' renders are kept in a folder beside ``out`` and read again by the next run.

    Args:
        docs: folder whose `environment.md` gets the figures anew.
        weights: pre-trained ones; the shipped by default.

    Raises:
        RaucaError: Blender or the weights are missing.
    """
    keep_large_blocks()
    results = Results("environment", settings)
    with threads(1):
        save_maps = _measure(results, out.parent / "environment", weights)
    summarize(results)
    results.publish(out, docs, "environment.md")
    save_curve(results, out.with_suffix(".svg"))
    save_maps(out.with_suffix(".jpg"))
    if docs is not None:
        save_curve(results, docs / PICTURES / "seconds-error.svg")
        save_maps(docs / PICTURES / "maps.jpg")
    return results


def _measure(results: Results, folder: Path, weights: Path | None) -> Callable[[Path], None]:
    """Fill the rows; returns what saves the figure of maps."""
    settings = results.settings
    # One list of frames: the first data set to train on, the second to test on.
    wanted = (sedan_data(settings), held_out_data(settings))
    frames = LightFrames([make_dataset(data, folder).folder for data in wanted])
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
    defaults = LightFrames([make_dataset(default_data(settings), folder).folder])
    near = find_truths(defaults, camouflages, settings, folder / "cycles")
    compare(results, "defaults", defaults, near, {"exact": lambda i, frame: exact_render(frame)})
    results.figures["epoch_time"] = time_epochs(frames, train_on, settings)
    weigh(results, frames, test_on, (ours.net, without.net))
    measure_curve(results, defaults, near, camouflages, folder / "cycles")
    for vehicle in settings.vehicles:
        own, unseen = (LightFrames([make_dataset(d, folder).folder]) for d in vehicle_data(vehicle, settings))
        results.add("vehicles", **adapt(vehicle, own, unseen, settings, weights))
    return lambda path: save_figure_of_maps(tests, truths, ours.net, settings.shown, path)


def sedan_data(settings: Settings) -> Wanted:
    """The sedan, in seen weathers."""
    views = f"--azimuths {settings.azimuths} --distances {_list(settings.distances_m)}"
    return _wanted("train", "sedan", settings.seen, settings, f"--locations {settings.locations} {views}", TRAIN_SEED)


def held_out_data(settings: Settings) -> Wanted:
    """The sedan, in seen and unseen weathers."""
    views = f"--azimuths {settings.test_azimuths} --distances {_list(settings.distances_m)}"
    weathers = (*settings.seen, *settings.unseen)
    return _wanted("test", "sedan", weathers, settings, f"--locations 1 {views}", TEST_SEED)


def default_data(settings: Settings) -> Wanted:
    """The sedan nearby in all weathers, at the default budget: what exact maps are judged on."""
    views = f"--locations 1 --azimuths 1 --distances {settings.distances_m[0]:g}"
    whole = settings.but(size=settings.exact_size)
    return _wanted("default", "sedan", (*settings.seen, *settings.unseen), whole, views, TEST_SEED)


def vehicle_data(vehicle: str, settings: Settings) -> tuple[Wanted, Wanted]:
    """Another vehicle, to fine-tune on in seen weathers, and to test on in unseen ones."""
    near = f"--distances {settings.distances_m[0] * 1.5}"
    many = f"--locations {settings.vehicle_locations} --azimuths {settings.vehicle_azimuths} {near}"
    few = f"--locations 1 --azimuths 2 {near}"
    train = _wanted(vehicle, vehicle, settings.seen, settings, many, TRAIN_SEED)
    return train, _wanted(f"{vehicle}-unseen", vehicle, settings.unseen, settings, few, TEST_SEED)


def _wanted(name: str, vehicle: str, weathers: Sequence[str], settings: Settings, views: str, seed: int) -> Wanted:
    options = f"--size {settings.size} --samples {settings.samples} --elevations 12 {views} {JITTER} --seed {seed}"
    return Wanted(name, vehicle, weathers_of(weathers), options)


def _list(values: Sequence[float]) -> str:
    return ",".join(f"{v:g}" for v in values)


def methods_of(frames: LightFrames, ours: LightSplitter, published: PublishedEfe) -> dict[str, Method]:
    """What is compared, by name; plain shading is rasterized anew, as in an attack's first step on a view."""
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


def error_of(
    results: Results,
    method: str,
    weathers: Iterable[str] = (),
    data: str = "sedan",
    region: str = "paint",
    **where: str,
) -> Error:
    """The error of a method over weathers (all by default) and textures."""
    chosen, sums = list(weathers), ("values", "squared", "absolute", "entropy")
    rows = results.where("errors", data=data, method=method, region=region, **where)
    return total(Error(**{key: row[key] for key in sums}) for row in rows if not chosen or row["weather"] in chosen)


def weigh(
    results: Results, frames: LightFrames, test_on: Sequence[int], nets: tuple[LightSplitter, LightSplitter]
) -> None:
    """What W of Eq. 5 is good for: the same training with and without it, near and far; the cut lies halfway."""
    cut = sum(results.settings.distances_m) / 2
    for distance, far in zip(results.settings.distances_m, (False, True), strict=True):
        part = [i for i in test_on if (frames.places[i].frame.distance_m > cut) == far]
        with_w, without_w = (splitter_db(net, frames, part) for net in nets)
        results.add("weighting", distance_m=distance, with_w_db=with_w, without_w_db=without_w)


def measure_curve(
    results: Results, frames: LightFrames, truths: Sequence[Truth], camouflages: Mapping[str, Path], folder: Path
) -> None:
    """What exact maps cost: render the truth's frames at every budget, as maps and textured, and compare.

    ``maps_s`` and ``render_s`` are CPU seconds per frame; of the maps, once for all textures.
    """
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


def summarize(results: Results) -> None:
    """Tables and targets from the rows."""
    _method_tables(results)
    _training_tables(results)
    _exact_targets(results)
    ours, published = (error_of(results, name).mse for name in ("ours", "published"))
    results.target("our MSE over the published", 0.5, ours / published, most=True)
    results.target(
        "our time over the published", 0.25, _cpu_ms(results, "ours") / _cpu_ms(results, "published"), most=True
    )
    counts = [results.one("training", name=name)["parameters"] for name in ("ours", "published")]
    results.target("our parameters over the published", 0.25, counts[0] / counts[1], most=True)
    times = results.figures["epoch_time"]
    results.target("epoch, base over final, both with our renderer", 13, times["base_s"] / times["final_s"])
    published_base = times["base_published_s"] / times["final_s"]
    results.target("epoch, base over final, base rendering as published", 13, published_base)
    results.target("epoch, base over ours", 20, times["base_s"] / times["ours_s"])
    for row in results.rows.get("vehicles", []):
        name, ratio = row["vehicle"], row["epochs_pretrained"] / row["epochs_scratch"]
        results.target(f"{name}: epochs pre-trained over from scratch, the paper's criterion", 0.2, ratio, most=True)
        if row["near_scratch"] and row["near_pretrained"] is not None:
            ratio = row["near_pretrained"] / row["near_scratch"]
            results.target(f"{name}: the same, to 5 % of the error from scratch", 0.2, ratio, most=True)
        results.target(f"{name}: fine-tuned, unseen weather", 28, row["after_db"], "dB")
    results.target_table()


def _cpu_ms(results: Results, method: str) -> float:
    return median(row["cpu_ms"] for row in results.where("errors", data="sedan", method=method, region="paint"))


def _method_tables(results: Results) -> None:
    settings, sedan = results.settings, results.where("errors", data="sedan")
    methods, weathers, textures = (
        list(dict.fromkeys(r[key] for r in sedan)) for key in ("method", "weather", "texture")
    )
    rows = [
        {
            "method": name, "all": error_of(results, name), "seen": error_of(results, name, settings.seen),
            "unseen": error_of(results, name, settings.unseen), "cpu_ms": _cpu_ms(results, name),
        }
        for name in methods
    ]  # fmt: skip
    columns = {
        "method": "{method}", "PSNR, dB": "{all.psnr_db:.2f}", "seen weather": "{seen.psnr_db:.2f}",
        "unseen": "{unseen.psnr_db:.2f}", "MSE": "{all.mse:.5f}", "MAE": "{all.mae:.4f}", "BCE": "{all.bce:.4f}",
        "CPU ms per image": "{cpu_ms:.1f}",
    }  # fmt: skip
    results.table("Textures never seen, against Cycles, on the paint", columns, rows)
    results.figures["methods"] = {
        row["method"]: {part: row[part].to_json() for part in ("all", "seen", "unseen")} for row in rows
    }
    by_method = {name: f"{{{name}.psnr_db:.1f}}" for name in methods}
    exact = {f"exact at {settings.exact_size} px, inside": "{inside.psnr_db:.1f}", "edges": "{edge.psnr_db:.1f}"}
    rows = [
        {"weather": w, **{name: error_of(results, name, [w]) for name in methods}, **_exact(results, w)}
        for w in weathers
    ]  # fmt: skip
    results.table("PSNR by weather, dB", {"weather": "{weather}", **by_method, **exact}, rows)
    rows = [{"texture": t, **{name: error_of(results, name, texture=t) for name in methods}} for t in textures]
    results.table("PSNR by texture, dB", {"texture": "{texture}", **by_method}, rows)


def _exact(results: Results, weather: str) -> dict[str, Error]:
    """Exact maps at the data set's default size and budget."""
    return {r: error_of(results, "exact", [weather], "defaults", r) for r in ("inside", "edge")}


def _training_tables(results: Results) -> None:
    settings, rows = results.settings, list[Row]()
    weathers = results.distinct("curve", "weather")
    for samples in results.distinct("curve", "samples"):
        points = {row["weather"]: row for row in results.where("curve", samples=samples)}
        seconds = {key: mean(p[key] for p in points.values()) for key in ("maps_s", "render_s")}
        rows.append({"samples": samples, **seconds, **points})
    columns = {"samples": "{samples}", "CPU s, maps and car": "{maps_s:.1f}, {render_s:.1f}"}
    columns |= {w: f"{{{w}[maps_db]:.1f}} / {{{w}[maps_edge_db]:.1f}}" for w in weathers}
    results.table(f"Exact maps by budget, {settings.exact_size} px, dB inside / on edges", columns, rows)
    times = results.figures["epoch_time"]
    loops = {
        "published": "base {base_s:.2f} ({base_published_s:.0f} with every face tested), final {final_s:.2f}",
        "ours": "{ours_s:.2f}",
    }
    rows = [row | {"loops": loops[row["name"]].format(**times)} for row in results.rows["training"]]
    columns = {
        "extractor": "{name}", "parameters": "{parameters:,}", "epochs trained": "{epochs}",
        "CPU s in all": "{cpu_seconds:.0f}", f"CPU s per epoch of {times['frames']} frames": "{loops}",
    }  # fmt: skip
    results.table("Training on the same frames", columns, rows)
    never = f"over {settings.most_epochs}"
    rows = [{k: never if v is None else v for k, v in row.items()} for row in results.rows.get("vehicles", [])]
    columns = {
        "vehicle": "{vehicle}", "epochs by the paper's criterion, from scratch": "{epochs_scratch}",
        "pre-trained": "{epochs_pretrained}",
        "epochs to within 5 % of the error from scratch, from scratch": "{near_scratch}",
        "the same, pre-trained": "{near_pretrained}",
        "from scratch to the pre-trained's first converged error": "{epochs_matched}",
        "MAE from scratch": "{mae_scratch:.4f}", "MAE pre-trained": "{mae_pretrained:.4f}",
        "unseen weather before, dB": "{before_db:.1f}", "fine-tuned, dB": "{after_db:.1f}",
    }  # fmt: skip
    results.table("Unseen vehicles: epochs from scratch and from pre-trained weights", columns, rows)
    columns = {"distance": "{distance_m:g} m", "with W": "{with_w_db:.2f}", "without": "{without_w_db:.2f}"}
    results.table("W of Eq. 5, PSNR by distance, dB", columns, results.rows["weighting"])


def _exact_targets(results: Results) -> None:
    weathers = list(dict.fromkeys(row["weather"] for row in results.where("errors", data="defaults")))
    inside, edges = ({w: _exact(results, w)[region].psnr_db for w in weathers} for region in ("inside", "edge"))
    for weather, wanted in ((CLEAR, 40), (FOG, 40), (NIGHT, 38)):
        if weather in inside:
            results.target(f"exact maps inside the paint, {weather}", wanted, inside[weather], "dB")
    results.target("exact maps inside the paint, worst weather", 35, min(inside.values()), "dB")
    if CLEAR in edges:
        results.target(f"exact maps on edges, {CLEAR}", 36, edges[CLEAR], "dB")
    results.target("exact maps on edges, worst weather", 32, min(edges.values()), "dB")
    if len(results.settings.budgets) > 1:
        gap = min(_gap(results.where("curve", weather=weather)) for weather in weathers)
        results.target("exact maps over the car itself at equal time, worst weather", 0, gap, "dB")


def _gap(curve: Sequence[Row]) -> float:
    """Least of the maps' PSNR, less that of rendering the car for the same time."""
    rows = sorted(curve, key=lambda row: float(row["samples"]))
    seconds, db = [np.log(row["render_s"]) for row in rows], [row["render_db"] for row in rows]
    return min(row["maps_db"] - float(np.interp(np.log(row["maps_s"]), seconds, db)) for row in rows)


def save_curve(results: Results, path: Path) -> None:
    """Error against CPU seconds per texture, one panel per weather."""
    panels = []
    for weather in results.settings.shown:
        rows = sorted(results.where("curve", weather=weather), key=lambda row: float(row["samples"]))
        lines = [
            Line(label, [(row[seconds] / textures, row[db], str(row["samples"])) for row in rows], {"marker": marker})
            for label, seconds, textures, db, marker in (
                ("rendering the car", "render_s", 1, "render_db", "s"),
                ("maps, 1st texture", "maps_s", 1, "maps_db", "o"),
                ("maps, 10th texture", "maps_s", 10, "maps_db", "^"),
            )
        ]
        panels.append(Panel(weather, lines))
    save_figure(path, panels, "CPU s per texture", "PSNR inside the paint, dB", 3.2)


ERROR_GAIN, ZOOM, GAP = 4, 2, 4  # GAP in pixels, between the pictures


def save_figure_of_maps(
    frames: LightFrames, truths: Sequence[Truth], net: LightSplitter, weathers: Sequence[str], path: Path
) -> None:
    """A row per weather: reference, A, B, the textured car as our extractor lights it, the truth, the error."""
    rows = []
    for weather in weathers:
        truth = next(t for t in truths if t.texture == SATURATED and frames.get(t.index).weather == weather)
        frame = frames.get(truth.index)
        light = estimate(frames.datasets[0], frames.places[truth.index].frame.id, net)
        seen = splitter_render(net, frame)(truth.albedo)[0]
        paint = frame.paint > 0
        # The truth was rendered around the paint only; the rest of the frame is the data set's own.
        rendered = (truth.first + truth.second) / 2 * paint + frame.image / 255 * ~paint
        error = ((seen - rendered).abs() * paint * ERROR_GAIN).clamp(max=1.0)
        maps = [linear_to_srgb(torch.from_numpy(m.transpose(2, 0, 1).copy())) for m in (light.A, light.B)]
        rows.append(_beside([_bytes(p) for p in (frame.image / 255, *maps, seen, rendered, error)], 1))
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(_beside(rows, 0).repeat(ZOOM, 0).repeat(ZOOM, 1)).save(path, quality=85)


def _beside(pictures: Sequence[np.ndarray], axis: int) -> np.ndarray:
    shape = list(pictures[0].shape)
    shape[axis] = GAP
    gap = np.full(shape, 255, np.uint8)
    return np.concatenate([part for picture in pictures for part in (gap, picture)][1:], axis)


def _bytes(image: Tensor) -> np.ndarray:
    return (image.permute(1, 2, 0).numpy() * 255 + 0.5).astype(np.uint8)
