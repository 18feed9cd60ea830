"""In a process of its own, with Blender: what frames cost, and how far from converged ones they are."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from blender_addon.jobs.dataset_job import completed
from blender_addon.scene import camera, composed_fog
from blender_addon.scene.annotate import Annotation
from blender_addon.scene.light_maps import MARGIN_PX, light_maps
from blender_addon.scene.render import Crop, render_linear
from blender_addon.scene.session import LightMemory, Session
from blender_addon.scene.vehicle_files import find_vehicle
from pipelines.dataset_options import dataset_job, dataset_parser
from rauca_core.contract import Progress, Quality, VehicleSource, Weather, find_preset, in_rendering_order
from rauca_core.contract.color import TRAIN, Color, recolor, srgb_to_linear
from rauca_core.contract.files import write_json
from rauca_core.contract.seeding import named_seed

from .dataset import KINDS, MAPS, SINGLE, Halves, Image, naive_samples, squared_errors
from .harness import Row, Settings, psnr_db

LOCATION = 0
REFERENCE_BOUNCES = 12
WEATHERS = {
    "clear": Weather("clear", 45.0),
    "foggy": Weather("foggy", 45.0, fog_density=50.0),
    "night": Weather("night", -30.0),
}
assert tuple(WEATHERS) == KINDS
LIGHTS = {"day": Weather("day", 45.0), "night": Weather("night", -30.0)}
COLORS: tuple[Color, ...] = ((128, 128, 128), (255, 0, 0))  # of the recoloring set: its middle, and a hard one
MOST_DB = 80.0  # errors are free of the references' noise, and may average out to 0 or less
Cpu = time.process_time  # Cycles runs inside this process, so its threads count


class Studio:
    """The default data set's scene: the sedan at the town's first place, seen by the default ring."""

    def __init__(self, size: int, views: set[int]) -> None:
        vehicle = find_vehicle(VehicleSource("sedan"))
        options = dataset_parser().parse_args(["--out", "bench", "--size", str(size), "--weathers", "single"])
        plan = completed(dataset_job(options), vehicle)
        self.default = plan.quality  # that `rauca dataset make` uses; the session's plan has that of a measurement
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.session = Session(plan, vehicle)
        self.session.enter(LOCATION)
        started = Cpu()
        self.sights: dict[int, Annotation] = dict(self.session.annotations(LOCATION, sorted(views)))
        self.coverage_s = (Cpu() - started) / len(views)  # of a camera's annotation, mean
        self._references: dict[tuple[Any, ...], Image] = {}

    def errors(self, view: int, frame: Image, halves: Halves) -> tuple[float, float, float]:
        return squared_errors(frame, halves, self.sights[view].paint > 0)

    def use(self, quality: Quality, weathers: tuple[Weather, ...] = ()) -> None:
        """Render as a plan of this quality and these weathers would; nothing rendered before is remembered."""
        self.session.plan = replace(self.session.plan, quality=quality, weathers=weathers or self.session.plan.weathers)
        self.session.memory = LightMemory(self.session.plan)

    def settle(self, view: int, weather: Weather) -> None:
        """Let Blender take the weather in, at one sample: what comes next is timed without that."""
        usual = self.session.plan
        self.session.plan = replace(usual, quality=Quality(1, denoise=False))
        self.render(view, weather, (0, 0, 0))
        self.session.plan = usual

    def render(self, view: int, weather: Weather, color: Color, draw: int = 0) -> Image:
        """One render in one color, linear; other draws have other noise."""
        self.session.set_weather(weather)
        red, green, blue = (float(c) for c in srgb_to_linear(np.array(color) / 255))
        self.session.vehicle.paint.set_color((red, green, blue))
        if not draw:
            return self.session.render(LOCATION, view, weather)
        camera.place(self.session.scene, self.session.viewpoint(LOCATION, view).camera)
        seed = named_seed("reference", draw, view) % 2**31
        return render_linear(self.session.scene, self.session.plan.quality, seed)[..., :3]

    def maps(self, view: int, weather: Weather) -> tuple[Image, Image]:
        self.session.set_weather(weather)
        grey = srgb_to_linear(np.array(self.session.plan.reference_srgb, np.float32) / 255)
        sight = self.sights[view]
        return light_maps(self.session, LOCATION, view, weather, sight.paint > 0, grey, sight)[:2]

    def reference(self, view: int, weather: Weather, color: Color, samples: int) -> Halves:
        """Two draws of a converged frame: long paths, every pixel all samples, no denoiser. Rendered once."""
        halves = []
        for draw in (1, 2):
            key = (view, weather.light_key(), color, samples, draw)
            if key not in self._references:
                self.use(Quality(samples, 0.0, False, REFERENCE_BOUNCES, False))
                self._references[key] = self.render(view, weather, color, draw)
            halves.append(self._references[key])
        return Halves(*halves)


def variants_of(settings: Settings, default: Quality) -> Iterator[tuple[str, str, Quality]]:
    """(what, axis, quality) of everything that is measured; the default light maps come first."""
    yield MAPS, "samples", default
    plain = replace(default, adaptive_threshold=0.0, denoise=True)
    for samples in settings.map_samples:
        if (quality := replace(plain, samples=samples)) != default:
            yield MAPS, "samples", quality
    for samples in settings.single_samples:
        yield SINGLE, "samples", replace(plain, samples=samples)
    for samples in settings.raw_samples:
        for what in (SINGLE, MAPS):
            yield what, "raw", replace(plain, denoise=False, samples=samples)
    for threshold in settings.thresholds:
        yield MAPS, "adaptive", replace(plain, samples=settings.adaptive_samples, adaptive_threshold=threshold)
    for bounces in settings.bounces:
        yield MAPS, "bounces", replace(default, bounces=bounces)
    yield MAPS, "fog", replace(default, composed_fog=not default.composed_fog)


def measure(studio: Studio, settings: Settings, kind: str, what: str, axis: str, quality: Quality) -> Row:
    weather, errors, cpu_s = WEATHERS[kind], [], 0.0
    for view in settings.views:
        halves = [studio.reference(view, weather, color, settings.reference_samples) for color in COLORS]
        spent_s, frames = (_through_maps if what == MAPS else _one_by_one)(studio, view, weather, quality)
        cpu_s += spent_s / len(settings.views)
        errors += [studio.errors(view, f, h) for f, h in zip(frames, halves, strict=True)]
    display, linear, paint = (psnr_db(column, MOST_DB) for column in zip(*errors, strict=True))
    found = {"psnr_db": display, "linear_psnr_db": linear, "paint_psnr_db": paint, "cpu_seconds": cpu_s}
    return {"what": what, "axis": axis, "kind": kind, **asdict(quality), **found}


def _through_maps(studio: Studio, view: int, weather: Weather, quality: Quality) -> tuple[float, list[Image]]:
    """Light maps as a data set makes them: where fog is composed, the clear view is there already."""
    clear = replace(weather, name="under", fog_density=0.0)
    studio.use(quality, (clear, weather))
    if quality.composed_fog and weather.extinction > 0:
        studio.maps(view, clear)
    studio.settle(view, weather)
    started = Cpu()
    A, B = studio.maps(view, weather)
    return Cpu() - started, [recolor(A, B, color) for color in COLORS]


def _one_by_one(studio: Studio, view: int, weather: Weather, quality: Quality) -> tuple[float, list[Image]]:
    studio.use(quality)
    studio.settle(view, weather)
    started = Cpu()
    frames = [studio.render(view, weather, color) for color in COLORS]
    return (Cpu() - started) / len(COLORS), frames


def measure_fog(studio: Studio, settings: Settings, light: str, density: float) -> Row:
    """Display PSNR, dB, of the grey vehicle in one fog by each of ``METHODS``, on the first view."""
    view, weather = settings.views[0], replace(LIGHTS[light], fog_density=density)
    clear, grey = replace(weather, name="under", fog_density=0.0), COLORS[0]
    halves = studio.reference(view, weather, grey, settings.fog_samples)
    studio.use(replace(studio.default, composed_fog=False))
    real = recolor(*studio.maps(view, weather), grey)
    studio.use(replace(studio.default, composed_fog=True), (clear, weather))
    unfogged = studio.render(view, clear, grey)
    studio.session.set_weather(weather)
    coarse = studio.session.render_coarse(LOCATION, view, weather)
    distance = studio.sights[view].distance
    everywhere = composed_fog.compose(coarse, unfogged, distance, weather.extinction)
    crop = Crop.around(studio.sights[view].vehicle > 0, MARGIN_PX)
    composed = everywhere if crop is None else composed_fog.blend(everywhere, real[crop.inside], crop.inside)
    formula = by_formula(coarse, unfogged, np.asarray(distance, np.float32), weather.extinction)
    frames = {"real": real, "composed": composed, "everywhere": everywhere, "formula": formula}
    db = {f"{n}_db": psnr_db(studio.errors(view, f, halves)[0], MOST_DB) for n, f in frames.items()}
    return {"light": light, "fog_density": density, "extinction": weather.extinction, **db}


def by_formula(coarse_linear: Image, clear_linear: Image, distance: Image, extinction: float) -> Image:
    """``k * T * clear + (1 - T) * airlight`` with the k and airlight per channel that fit the coarse picture best."""
    through = np.exp(-extinction * distance)[..., None].astype(np.float64)
    result = np.empty_like(clear_linear)
    for channel in range(3):
        guides = np.stack([through[..., 0] * clear_linear[..., channel], 1 - through[..., 0]], axis=-1)
        rows = composed_fog.coarsen(guides).reshape(-1, 2)
        scale = np.linalg.lstsq(rows, coarse_linear[..., channel].reshape(-1), rcond=None)[0]
        result[..., channel] = guides @ scale
    return result


def ours_of_a_set(studio: Studio, view: int, weathers: Sequence[Weather]) -> float:
    """CPU seconds of every weather in nine colors as a data set's loop goes: lights together, fog growing."""
    studio.use(studio.default, tuple(weathers))
    started = Cpu()
    for weather in in_rendering_order(list(weathers)):
        A, B = studio.maps(view, weather)
        for color in TRAIN:
            recolor(A, B, color)
    return Cpu() - started + studio.coverage_s


def naive_of_a_set(studio: Studio, view: int, weathers: Sequence[Weather], samples: dict[str, int]) -> float:
    """The same, one render at a time and without coverage; two of nine colors stand for all."""
    total = 0.0
    for weather in weathers:
        # Which kind's error stands for the weather's; a foggy night counts as fog.
        kind = "foggy" if weather.extinction > 0 else "night" if weather.is_night else "clear"
        studio.use(replace(studio.default, samples=samples[kind], adaptive_threshold=0.0))
        started = Cpu()
        studio.render(view, weather, TRAIN[0])
        between = Cpu()
        studio.render(view, weather, TRAIN[-1])
        total += between - started + (Cpu() - between) * (len(TRAIN) - 1)
    return total


def main(settings: dict[str, Any], out: str) -> None:
    chosen = Settings(**settings)
    studio = Studio(chosen.size, {*chosen.views, *(view for _, views in chosen.sets for view in views)})
    variants = [(kind, *variant) for kind in KINDS for variant in variants_of(chosen, studio.default)]
    variants = [variant for variant in variants if variant[0] == "foggy" or variant[2] != "fog"]
    fogs = [(light, density) for light in LIGHTS for density in chosen.fog_densities]
    sets = [(preset, view) for preset, views in chosen.sets for view in views]
    total = len(variants) + len(fogs) + len(sets)
    rows: dict[str, list[Row]] = {"entries": [], "fog_curve": [], "sets": []}

    def add(kind: str, row: Row, last: str) -> None:
        rows[kind].append(row)
        print(Progress(sum(map(len, rows.values())), total, last).line(), flush=True)

    for kind, what, axis, quality in variants:
        add("entries", measure(studio, chosen, kind, what, axis, quality), f"{kind}: {what}, {axis}")
    for light, density in fogs:
        add("fog_curve", measure_fog(studio, chosen, light, density), f"fog {density:g}, {light}")
    samples = {kind: naive_samples([entry for entry in rows["entries"] if entry["kind"] == kind]) for kind in KINDS}
    for preset, view in sets:
        weathers = find_preset(preset)
        ours, naive = ours_of_a_set(studio, view, weathers), naive_of_a_set(studio, view, weathers, samples)
        row = {"preset": preset, "view": view, "frames": len(weathers) * len(TRAIN), "naive_samples": samples}
        add("sets", row | {"ours_s": ours, "naive_s": naive, "speedup": naive / ours}, f"{preset}, view {view}")
    figures = {"blender": bpy.app.version_string, "default": studio.default.to_json()}
    write_json(Path(out), {"figures": figures | {"coverage_cpu_seconds": studio.coverage_s}, "rows": rows})
