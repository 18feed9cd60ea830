"""The neural renderer's speed against its error, beside other renderers, Embree and Cycles: ``rauca bench render``."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from pipelines.console import progress_bar
from rauca_core.contract import Camera, Vehicle
from rauca_core.render import MipmappedTexture, Pyramid, TapCache, Taps, TapSettings, build_taps, rasterize
from rauca_core.render.sampler import Sampler
from rauca_core.runtime.cpu import keep_large_blocks, threads

from .algorithm2 import Facets, fill, pixels_from_cells
from .harness import Line, Panel, Results, Row, Settings, save_figure
from .in_blender import open_vehicle
from .render_agreement import compare_with_blender, premultiplied, psnr_db
from .render_reference import (
    RINGS,
    TEXTURES,
    RayCaster,
    Reference,
    box_of,
    ray_directions,
    render_reference,
    ring,
    uv_map,
)
from .timing import Clock, counted, race

FULL = Settings(
    sizes=(320, 640),  # of the square images, pixels
    uv_size=2048,  # of the UV map, texels; the published renderer's
    views={"paper": 8, "close": 3},  # cameras of each ring
    reach_views=32,  # cameras over which the reach of gradients is counted
    samples=(1, 2, 4, 8, 12),  # subsamples per pixel and axis at which our renderer is measured
    reference_samples=16,  # subsamples per pixel and axis of the reference
    repeats=15,  # timings of which the median is taken
    steps=5,  # steps of Algorithm 2 that are timed; each takes most of a second
    cameras=32,  # random cameras per vehicle for the agreement with Blender
    camera_size=320,  # their image size, pixels
    mask_samples=1024,  # of Cycles per pixel, for coverage masks
    color_samples=256,  # and for the albedo
    color_views=2,  # cameras of the albedo comparison
)
QUICK = FULL.but(
    sizes=(640,),
    views={"paper": 3, "close": 1},
    reach_views=4,
    samples=(1, 2, 4, 8),
    repeats=5,
    steps=2,
    cameras=2,
    mask_samples=256,
    color_views=1,
)

ALGORITHM_2 = "Algorithm 2, 2x2"
BILINEAR = "1 bilinear sample"
PSNR_DB = {2: 28.0, 4: 35.0, 8: 41.0}  # hoped for, by subsamples per axis
PICTURES = Path("pictures") / "renderer"


@dataclass(frozen=True)
class Renderer:
    """How texels are looked up, and how many subsamples a pixel has along each axis. All run through one operator."""

    name: str
    sampler: Sampler
    samples: int

    def taps(self, vehicle: Vehicle, camera: Camera, pyramid: Pyramid) -> Taps:
        """Its taps with the box filter, which is the reference's."""
        return build_taps(vehicle, camera, pyramid.size, self.samples, "box", pyramid=pyramid, sampler=self.sampler)


def ours(samples: int) -> Renderer:
    """Our renderer with that many subsamples per axis."""
    return Renderer(f"ours {samples}x{samples}", Sampler.AREA, samples)


PUBLISHED = (Renderer("Algorithm 1, 2x2", Sampler.TENSOR_TRAVERSAL, 2), Renderer(ALGORITHM_2, Sampler.UV_TRAVERSAL, 2))
SIMPLE = (Renderer(BILINEAR, Sampler.BILINEAR, 1), Renderer("1 trilinear sample", Sampler.TRILINEAR, 1))


def renderers(samples: Sequence[int]) -> list[Renderer]:
    """Samplers of the literature, the published algorithms at their published 2x2, ours at each of ``samples``."""
    return [*SIMPLE, *PUBLISHED, *(ours(n) for n in samples)]


@dataclass(frozen=True, eq=False)
class Car:
    """A vehicle and what is prepared for it once.

    Attributes:
        maps: (K, size, size, 3) the textures, linear.
        texels: per texture all mip levels (T, 3) of the map, linear.
    """

    name: str
    vehicle: Vehicle
    pyramid: Pyramid
    caster: RayCaster
    maps: NDArray[np.float32]
    texels: list[Tensor]

    @staticmethod
    def of(name: str, vehicle: Vehicle, uv_size: int) -> Car:
        """Pyramid, ray caster and textures of a vehicle.

        Raises:
            RaucaError: Embree is missing.
        """
        caster, pyramid = RayCaster(vehicle), Pyramid.of(vehicle, uv_size)
        maps = np.stack([uv_map(kind, pyramid) for kind in TEXTURES])
        texels = [pyramid(pyramid.from_map(torch.from_numpy(m).permute(2, 0, 1))) for m in maps]
        return Car(name, vehicle, pyramid, caster, maps, texels)

    def texture(self) -> MipmappedTexture:
        """The first texture, that asks for gradients."""
        return MipmappedTexture(self.pyramid, self.texels[0][: len(self.pyramid.texels)].clone().requires_grad_())


@dataclass(frozen=True, eq=False)
class Scene:
    """A ring of cameras around a car, and the reference of each view."""

    car: Car
    ring: str
    size: int
    cameras: list[Camera]
    references: list[Reference]

    @staticmethod
    def of(car: Car, ring_name: str, size: int, settings: Settings, moved: Callable[[], None]) -> Scene:
        """Render the references; ``moved`` is called after each view."""
        cameras, references = ring(car.vehicle, ring_name, settings.views[ring_name], size), []
        for camera in cameras:
            samples = settings.reference_samples
            references.append(render_reference(car.vehicle, car.caster, camera, car.maps, samples))
            moved()
        return Scene(car, ring_name, size, cameras, references)


def bench(
    out: Path,
    settings: Settings,
    docs: Path | None = None,
    vehicle: str | None = None,
    paint_mask: Path | None = None,
    paint_material: str | None = None,
    blender: bool = True,
) -> Results:
    """Measure the default sedan and, if given, another vehicle; write ``out`` (JSON) and a plot beside it.

    Args:
        docs: folder whose `renderer.md` gets the figures anew, and its pictures the plot and the errors.
        vehicle: name, vehicle folder, or an .obj, .glb or .blend file; targets are judged on it, else on the sedan.
        blender: compare with Cycles too.

    Raises:
        RaucaError: a vehicle that cannot be opened; Embree or Blender is missing.
    """
    given = open_vehicle(vehicle or "sedan", paint_mask, paint_material)
    cars = {"sedan": open_vehicle("sedan"), given.name: given}
    results = Results("render", settings, figures={"main_vehicle": given.name, "rival_vehicle": given.name})
    results.rows = {name: [] for name in ("renderers", "speedups", "raster", "reach", "streamed", "blender")}
    keep_large_blocks()
    for name, model in cars.items():
        with threads(1):
            scene = _measure_car(results, name, model)
            if name == given.name:
                _measure_reach(results, scene.car)
        if docs is not None and name == given.name:
            save_pictures(scene, docs / PICTURES)
        del scene
        if name == given.name:
            with threads(1):
                _measure_rivals(results, name, model)
        if blender:
            with progress_bar(f"{name}: Cycles", resumes=False) as move:
                results.add("blender", **compare_with_blender(name, model, settings, move))
    summarize(results, list(cars))
    results.publish(out, docs, "renderer.md")
    save_plot(results, out.with_suffix(".svg"))
    if docs is not None:
        save_plot(results, docs / PICTURES / "speed-error.svg")
    return results


def _measure_car(results: Results, name: str, vehicle: Vehicle) -> Scene:
    """Everything but Blender; returns the largest paper scene, for pictures."""
    settings, everyone = results.settings, renderers(results.settings.samples)
    car = Car.of(name, vehicle, settings.uv_size)
    (tiny,) = ring(vehicle, "paper", 1, 32)
    for renderer in everyone:  # compiling is not what is measured
        renderer.taps(vehicle, tiny, car.pyramid)
    for ring_name in RINGS:
        for size in settings.sizes:
            turns = 2 * settings.views[ring_name] + len(everyone) * (settings.repeats + 2)
            with counted(f"{name}: {ring_name} ring, {size} px", turns) as moved:
                scene = Scene.of(car, ring_name, size, settings, moved)
                measure_scene(results, scene, everyone, moved)
                time_raster(results, scene, moved)
                if ring_name == "paper" and size == max(settings.sizes):
                    shown = scene
                    measure_speedup(results, scene)
                    measure_streaming(results, scene)
    return shown


def _measure_rivals(results: Results, name: str, vehicle: Vehicle) -> None:
    """Algorithms 1 and 2 as they are published: on a car that is textured all over, where its atlas allows that."""
    settings, whole = results.settings, painted_all_over(vehicle)
    if whole is None:
        return
    results.figures["rival_vehicle"] = name = f"{name}, painted all over"
    car, size = Car.of(name, whole, settings.uv_size), max(settings.sizes)
    rivals = [*PUBLISHED, ours(2)]
    with counted(f"{name}: paper ring, {size} px", settings.views["paper"] + 3 * (settings.repeats + 2)) as moved:
        scene = Scene.of(car, "paper", size, settings, moved)
        measure_scene(results, scene, rivals, moved)
        measure_speedup(results, scene)


def painted_all_over(vehicle: Vehicle) -> Vehicle | None:
    """The vehicle with every face painted, as the published renderer textures it; None without an atlas for that."""
    a, b, c = vehicle.uvs.astype(np.float64).transpose(1, 0, 2)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    unwrapped = np.abs(ux * vy - uy * vx) > 0
    if unwrapped.mean() < 0.9:
        return None
    materials = [replace(material, kind="paint") for material in vehicle.materials]
    return replace(vehicle, materials=materials, paint_mask=np.full_like(vehicle.paint_mask, 255))


def measure_scene(results: Results, scene: Scene, everyone: Sequence[Renderer], moved: Callable[[], None]) -> None:
    """A row per renderer and texture.

    ``psnr_db`` is over the pixels that show paint, ``forward_ms`` and ``backward_ms`` are per image, taps in memory,
    the ring as one batch, one core; ``build_ms`` makes one view's taps; ``reached`` is the share of the ring's visible
    paintable texels that receive gradient.
    """
    car, taps, build_ms = scene.car, dict[str, list[Taps]](), dict[str, float]()
    for renderer in everyone:
        views, clock = [], Clock()
        for camera in scene.cameras:
            views.append(renderer.taps(car.vehicle, camera, car.pyramid))
            clock.lap()
        taps[renderer.name], build_ms[renderer.name] = views, float(np.median(clock.laps))
        moved()
    # As in the optimizer, one call serves the batch, and its gradient is added to one buffer of all texels. Building
    # the mip levels, and handing that gradient down to the UV map, is paid once per step: see `measure_speedup`.
    texture = car.texture()
    steps = race(
        {name: lambda clock, v=views: _step(v, texture, clock) for name, views in taps.items()},  # type: ignore[misc]
        results.settings.repeats,
        moved=moved,
    )
    visible = touched_texels(car.pyramid, scene.references)
    for renderer in everyone:
        views = taps[renderer.name]
        forward_ms, backward_ms = (np.median(steps[renderer.name], 0) / len(views)).tolist()
        # Pixels without paint only carry their neighbors' texture, in case the light maps need it.
        numbers = [np.diff(view.rows.indptr)[view.alpha > 0] for view in views]
        reached = reached_texels(car.pyramid, views)
        for number, kind in enumerate(TEXTURES):
            results.add(
                "renderers", name=renderer.name, vehicle=car.name, ring=scene.ring, size=scene.size, texture=kind,
                psnr_db=ring_psnr_db(scene, views, number), forward_ms=forward_ms, backward_ms=backward_ms,
                step_ms=forward_ms + backward_ms, build_ms=build_ms[renderer.name],
                taps_per_pixel=mean(float(n.mean()) if len(n) else 0.0 for n in numbers),
                reached=float((reached & visible).sum() / max(visible.sum(), 1)),
            )  # fmt: skip


def _step(views: Sequence[Taps], texture: MipmappedTexture, clock: Clock) -> Tensor:
    """Laps of forward and backward; returns the gradient that is left to take down the mip levels."""
    operators = [view.rows for view in views]
    clock.restart()
    pixels = texture.sample(operators)
    clock.lap()
    asked = torch.ones_like(pixels)
    clock.restart()
    (gradient,) = torch.autograd.grad(pixels, texture.ticket, asked)
    clock.lap()
    return gradient


def ring_psnr_db(scene: Scene, views: Sequence[Taps], texture: int) -> float:
    """PSNR over all pixels of all views that show paint: near views, which show more of it, count for more."""
    errors = []
    for view, reference in zip(views, scene.references, strict=True):
        image = premultiplied(view, scene.car.texels[texture])
        shown = (reference.coverage > 0) | (image > 0).any(2)
        errors.append(np.asarray((image[shown] - reference.colors[texture][shown]) ** 2, np.float64))
    return psnr_db(np.concatenate(errors))


def touched_texels(pyramid: Pyramid, references: Sequence[Reference]) -> NDArray[np.bool_]:
    """(P,) which of the pyramid's paintable texels any subsample of the references weighs."""
    seen = np.any([reference.touched for reference in references], 0)
    return np.asarray(seen.ravel()[pyramid.texels])


def reached_texels(pyramid: Pyramid, views: Sequence[Taps]) -> NDArray[np.bool_]:
    """(P,) which texels receive gradient when every pixel asks for more light, over all views."""
    texels = torch.zeros(len(pyramid.texels), 3, requires_grad=True)
    levels = pyramid(texels)
    # Every weight is positive, so nothing cancels: zero gradient means out of reach.
    asked = sum((view.rows(levels).sum() for view in views), levels.new_zeros(()))
    (gradient,) = torch.autograd.grad(asked, texels)
    return gradient[:, 0].numpy() > 0


def _measure_reach(results: Results, car: Car) -> None:
    """Share of the texels that a ring of many views shows, at the largest size, to which each gradient comes.

    The paper claims all of them for its sampler; texels that a few views show at the rim only are the ones that get
    lost, and what is not reached keeps its random start and is printed so.
    """
    settings = results.settings
    everyone = [renderer for renderer in renderers(settings.samples) if renderer.samples <= 8]
    cameras = ring(car.vehicle, "paper", settings.reach_views, max(settings.sizes))
    with counted(f"{car.name}: reach of gradients", len(cameras) * (len(everyone) + 1)) as moved:
        references = []
        for camera in cameras:
            seen = render_reference(car.vehicle, car.caster, camera, car.maps[:1], settings.reference_samples)
            references.append(Reference(np.empty(0), np.empty(0), seen.touched))
            moved()
        visible = touched_texels(car.pyramid, references)
        for renderer in everyone:
            reached = np.zeros(len(visible), bool)
            for camera in cameras:
                reached |= reached_texels(car.pyramid, [renderer.taps(car.vehicle, camera, car.pyramid)])
                moved()
            share = float((reached & visible).sum() / max(visible.sum(), 1))
            results.add("reach", name=renderer.name, share=share)


def time_raster(results: Results, scene: Scene, moved: Callable[[], None]) -> None:
    """Our rasterizer against Embree, one sample per pixel: medians over a ring's views.

    ``ours_ms`` includes the vertex transform; ``embree_ms`` is the query alone, of rays made beforehand through the
    pixels of the car's box, tree built beforehand; ``trimesh_ms`` the same through trimesh's ``intersects_first``,
    which copies and normalizes the rays; ``same_face`` the share of the box's pixels for which both name one face.
    """
    vehicle, caster, found = scene.car.vehicle, scene.car.caster, []
    for camera in scene.cameras:
        x0, y0, x1, y1 = box_of(vehicle, camera)
        x, y = (a.ravel() for a in np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5))
        directions = ray_directions(camera, x, y).astype(np.float32)
        origins = np.broadcast_to(camera.position.astype(np.float32), directions.shape).copy()
        contenders: Mapping[str, Callable[[Clock], object]] = {
            "ours_ms": lambda _, c=camera: rasterize(vehicle.positions, vehicle.triangles, c),  # type: ignore[misc]
            "embree_ms": lambda _, o=origins, d=directions: caster.first_faces(o, d),  # type: ignore[misc]
            "trimesh_ms": lambda _, o=origins, d=directions: caster.intersector.intersects_first(o, d),  # type: ignore[misc]
        }
        times = {name: float(np.median(laps)) for name, laps in race(contenders, results.settings.repeats).items()}
        whole = rasterize(vehicle.positions, vehicle.triangles, camera).whole(camera.width, camera.height)
        theirs = caster.first_faces(origins, directions).reshape(y1 - y0, x1 - x0)
        found.append({"rays": len(directions), **times, "same_face": float((whole[y0:y1, x0:x1] == theirs).mean())})
        moved()
    medians = {name: float(np.median([row[name] for row in found])) for name in found[0]}
    ratio = medians["ours_ms"] / medians["trimesh_ms"]
    results.add("raster", vehicle=scene.car.name, ring=scene.ring, size=scene.size, **medians, ratio=ratio)


def measure_speedup(results: Results, scene: Scene) -> None:
    """A step from the UV map to one view's pixels, and the gradient back: Algorithm 2 as published, and our 2x2.

    On the scene's median view by paint shown. ``levels_*_ms`` is UV map to mip levels, and back, which clears the
    gradient's buffer for the next step: once per step for any batch. ``operator`` is what each image of a large batch
    gains, ``whole_step`` what a step of a single image does.
    """
    shown = [int((reference.coverage > 0).sum()) for reference in scene.references]
    camera = scene.cameras[sorted(range(len(shown)), key=shown.__getitem__)[len(shown) // 2]]
    car, pyramid = scene.car, scene.car.pyramid
    facets, (_, pixels_of) = Facets.of(car.vehicle, pyramid.size), pixels_from_cells(car.vehicle, camera)
    whole_map = torch.from_numpy(car.maps[0]).requires_grad_()
    taps = ours(2).taps(car.vehicle, camera, pyramid)
    texels = pyramid.from_map(torch.from_numpy(car.maps[0]).permute(2, 0, 1)).requires_grad_()

    def algorithm_2(clock: Clock) -> None:
        colors = pixels_of(fill(whole_map, facets))
        clock.lap()
        torch.autograd.grad(colors, whole_map, torch.ones_like(colors))
        clock.lap()

    def ours_2x2(clock: Clock) -> None:
        for _ in range(4):  # it is short: the last of a few, its caches as warm as in a run
            clock.restart()
            texture = MipmappedTexture(pyramid, texels)
            clock.lap()
            gradient = _step([taps], texture, clock)
            torch.autograd.grad(texture.ticket, texels, gradient)
            clock.lap()
        clock.laps[:] = clock.laps[-4:]

    laps = race({"algorithm 2": algorithm_2, "ours": ours_2x2}, results.settings.steps)
    (a2_forward, a2_backward), (up, forward, backward, down) = (np.median(rows, 0).tolist() for rows in laps.values())
    results.add(
        "speedups", vehicle=car.name, algorithm2_forward_ms=a2_forward, algorithm2_backward_ms=a2_backward,
        ours_forward_ms=forward, ours_backward_ms=backward, levels_forward_ms=up, levels_backward_ms=down,
        operator=(a2_forward + a2_backward) / (forward + backward),
        whole_step=(a2_forward + a2_backward) / (forward + backward + up + down),
    )  # fmt: skip


def measure_streaming(results: Results, scene: Scene) -> None:
    """Read a view's taps from the cache on disk, apply them and their transpose: milliseconds per image.

    Nothing is held in memory but the system's own page cache: a step that meets each view once in a long run.
    """
    texture, rounds = scene.car.texture(), min(results.settings.repeats, 5)
    settings = TapSettings(scene.car.pyramid.size, 2, "box")
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        # A new cache each time holds nothing in memory; opening it is not part of a step. The first builds the taps.
        caches = iter([TapCache(Path(temporary), scene.car.vehicle, settings) for _ in range(rounds + 1)])

        def step(clock: Clock) -> None:
            cache = next(caches)
            clock.restart()
            pixels = texture.sample([cache.get(camera).rows for camera in scene.cameras])
            torch.autograd.grad(pixels, texture.ticket, torch.ones_like(pixels))

        (laps,) = race({"streamed": step}, rounds).values()
    results.add("streamed", vehicle=scene.car.name, ms=float(np.median(laps)) / len(scene.cameras))


def summarize(results: Results, vehicles: Sequence[str]) -> None:
    """Headlines, tables and targets; the page has the main vehicle at the largest size."""
    settings, figures = results.settings, results.figures
    main, rival, largest = figures["main_vehicle"], figures["rival_vehicle"], max(settings.sizes)
    speedup = results.one("speedups", vehicle=rival)
    figures["speedup_vs_algorithm2"] = speedup["operator"]
    figures["speedup_vs_algorithm2_single_image_with_levels"] = speedup["whole_step"]
    figures["raster_vs_embree"] = max(row["ratio"] for row in results.rows["raster"])
    scenes = [(vehicle, name, size) for vehicle in vehicles for name in RINGS for size in settings.sizes]
    scenes += [(rival, "paper", largest)] if rival != main else []
    columns = {
        "renderer": "{name}", "noise, dB": "{noise_db:.1f}", "photo-like, dB": "{psnr_db:.1f}",
        "forward, ms": "{forward_ms:.2f}", "backward, ms": "{backward_ms:.2f}", "build, ms": "{build_ms:.0f}",
        "taps per pixel": "{taps_per_pixel:.1f}", "texels reached": "{reached:.2%}",
    }  # fmt: skip
    for vehicle, ring_name, size in scenes:
        noise, photo = (
            results.where("renderers", vehicle=vehicle, ring=ring_name, size=size, texture=kind) for kind in TEXTURES
        )
        rows = [{**b, "noise_db": a["psnr_db"]} for a, b in zip(noise, photo, strict=True)]
        on_page = vehicle in (main, rival) and size == largest
        results.table(f"{vehicle}, {ring_name} ring, {size} px", columns, rows, on_page)
    _targets(results)
    results.target_table(f"Targets ({main}, paper ring)")
    title = f"Visible texels that receive gradient: {main}, {settings.reach_views} views"
    results.table(title, {"renderer": "{name}", "reached": "{share:.4%}"}, results.rows["reach"])
    costs = [
        (what.format(**row), ms.format(**row))
        for kind, what, ms in (
            ("speedups", "{vehicle}: mip levels from the UV map, and back",
             "{levels_forward_ms:.1f} + {levels_backward_ms:.1f}"),
            ("speedups", "{vehicle}: Algorithm 2, one view",
             "{algorithm2_forward_ms:.0f} + {algorithm2_backward_ms:.0f}"),
            ("speedups", "{vehicle}: ours 2x2, the same view", "{ours_forward_ms:.2f} + {ours_backward_ms:.2f}"),
            ("speedups", "{vehicle}: times as fast; with mip levels, one image", "{operator:.0f}; {whole_step:.0f}"),
            ("raster", "{vehicle}, {ring} ring, {size} px: our raster; Embree through trimesh; bare",
             "{ours_ms:.2f}; {trimesh_ms:.2f}; {embree_ms:.2f}"),
        )
        for row in results.rows[kind]
    ]  # fmt: skip
    results.table("What else costs time", {"what": "{what}", "ms": "{ms}"}, [{"what": a, "ms": b} for a, b in costs])


def _targets(results: Results) -> None:
    """All targets, on the main vehicle's paper ring at the largest size; Blender's on every vehicle."""
    settings, figures = results.settings, results.figures
    main, rival = figures["main_vehicle"], figures["rival_vehicle"]

    def find(name: str, texture: str, vehicle: str = main) -> Row:
        place = {"ring": "paper", "size": max(settings.sizes), "vehicle": vehicle}
        return results.one("renderers", name=name, texture=texture, **place)

    target = results.target
    for n, wanted in PSNR_DB.items():
        for kind in TEXTURES:
            if n in settings.samples:
                target(f"{ours(n).name}, {kind}", wanted, find(ours(n).name, kind)["psnr_db"], "dB")
    for kind in TEXTURES:
        ours_db, theirs_db = (find(name, kind, rival)["psnr_db"] for name in (ours(2).name, ALGORITHM_2))
        target(f"less error than {ALGORITHM_2}, {kind}, {rival}", 10, ours_db - theirs_db, "dB")
    target(f"times as fast as {ALGORITHM_2}, {rival}", 150, figures["speedup_vs_algorithm2"])
    target("rasterizer's time over Embree's, worst", 1, figures["raster_vs_embree"], most=True)
    step_ms, streamed_ms = find(ours(2).name, TEXTURES[0])["step_ms"], results.one("streamed", vehicle=main)["ms"]
    target("forward + backward, 2x2, in memory", 1, step_ms, "ms", most=True)
    target("forward + backward, 2x2, from the cache", 3, streamed_ms, "ms", most=True)
    reached = results.one("reach", name=ours(8).name)["share"]
    target("visible texels that receive gradient, 8x8", 100, 100 * reached, "%")
    for row in results.rows["blender"]:
        vehicle = row["vehicle"]
        target(f"{vehicle} against Cycles inside, 4x4", 48, row["inside_db"], "dB")
        target(f"{vehicle} against Cycles on edges, 4x4", 38, row["edge_db"], "dB")
        target(f"{vehicle} mask IoU with Cycles, 12x12, mean", 0.998, row["iou_mean"]["12"])
        target(f"{vehicle} UV error, median", 0.05, row["uv_median"], "texel", most=True)
        target(f"{vehicle} UV error, 99th percentile", 0.5, row["uv_p99"], "texel", most=True)


def save_plot(results: Results, path: Path) -> None:
    """Speed against error on the main vehicle at the largest size: a panel per ring, a color per texture."""
    main, size, panels = results.figures["main_vehicle"], max(results.settings.sizes), []
    for ring_name in RINGS:
        lines = []
        for kind, color in zip(TEXTURES, ("C0", "C1"), strict=True):
            rows = results.where("renderers", vehicle=main, ring=ring_name, size=size, texture=kind)
            points = [(row["step_ms"], row["psnr_db"], row["name"]) for row in rows]
            mine = [(x, y, name.removeprefix("ours ")) for x, y, name in points if name.startswith("ours")]
            others = [point for point in points if not point[2].startswith("ours")]
            if ring_name == "paper":
                step = results.one("speedups", vehicle=main)
                step_ms = step["algorithm2_forward_ms"] + step["algorithm2_backward_ms"]
                others += [(step_ms, y, "as published") for _, y, name in others if name == ALGORITHM_2]
            lines.append(Line(f"ours, {kind}", mine, {"color": color}))
            lines.append(Line(f"others, {kind}", others, {"color": color, "linestyle": "", "fillstyle": "none"}))
        panels.append(Panel(f"{main}, {ring_name} ring, {size} px", lines))
    x, y = "forward + backward per image, ms, one core", "PSNR against 256 samples per pixel, dB"
    save_figure(path, panels, x, y, width=5, share=False)


CROP, ZOOM, ERROR_GAIN = 72, 4, 4  # pixels; times as large; times as bright
PHOTOGRAPH = 1  # noise looks alike in every renderer


def save_pictures(scene: Scene, folder: Path) -> None:
    """The same crop of one view: the reference, and each renderer's result beside its distance from it."""
    view = int(np.argmax([(r.coverage > 0).sum() for r in scene.references]))
    reference = scene.references[view].colors[PHOTOGRAPH]
    window = _busiest(scene.references[view].coverage)
    _save(reference[window], None, folder / "reference.jpg")
    for renderer in renderers((1, 2, 4, 8)):
        taps = renderer.taps(scene.car.vehicle, scene.cameras[view], scene.car.pyramid)
        found = premultiplied(taps, scene.car.texels[PHOTOGRAPH])
        name = re.sub(r"[^a-z0-9]+", "-", renderer.name.lower())
        _save(found[window], np.abs(found - reference)[window], folder / f"{name}.jpg")


def _busiest(coverage: NDArray[np.float64]) -> tuple[slice, slice]:
    """The crop with the most paint edges that is still mostly paint."""
    side = min(CROP, *coverage.shape)
    partly = ((coverage > 0.02) & (coverage < 0.98)) + 0.1 * (coverage > 0.98)
    total = np.pad(partly.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    sums = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    y, x = np.unravel_index(np.argmax(sums), sums.shape)
    return slice(int(y), int(y) + side), slice(int(x), int(x) + side)


def _save(linear: NDArray[np.floating], difference: NDArray[np.floating] | None, path: Path) -> None:
    """Colors are encoded by a square root, near enough to sRGB to look at; differences stay linear."""
    parts = [np.sqrt(np.clip(linear, 0, 1))]
    if difference is not None:
        parts.append(np.clip(difference * ERROR_GAIN, 0, 1))
    joined = (np.concatenate(parts, 1) * 255).astype(np.uint8).repeat(ZOOM, 0).repeat(ZOOM, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(joined).save(path, quality=80)
