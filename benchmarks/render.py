"""``rauca bench render``: speed against error, beside other renderers, Embree and Cycles."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import mean

import numpy as np
import torch

from pipelines.console import progress_bar
from rauca_core.contract import Vehicle
from rauca_core.render import MipmappedTexture, TapCache, Taps, TapSettings, rasterize
from rauca_core.runtime.devices import keep_large_blocks, threads

from .algorithm2 import Facets, fill, pixels_from_cells
from .harness import Clock, Results, Settings, counted, race
from .in_blender import open_vehicle
from .render_agreement import compare_with_blender
from .render_contenders import (
    PUBLISHED,
    Car,
    Renderer,
    Scene,
    ours,
    painted_all_over,
    reached_texels,
    renderers,
    timed_step,
    touched_texels,
)  # fmt: skip
from .render_reference import RINGS, TEXTURES, box_of, ray_directions, render_reference, ring
from .render_report import save_pictures, save_plot, summarize

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


def bench(
    out: Path,
    settings: Settings,
    docs: Path | None = None,
    vehicle: str | None = None,
    paint_mask: Path | None = None,
    paint_material: str | None = None,
    blender: bool = True,
) -> Results:
    """Measure the sedan and, if given, another vehicle, see :func:`open_vehicle`, on which targets are judged then.

    Raises:
        RaucaError: a vehicle that cannot be opened; Embree or Blender is missing.
    """
    given = open_vehicle(vehicle or "sedan", paint_mask, paint_material)
    results = Results("render", settings, figures={"main_vehicle": given.name, "rival_vehicle": given.name})
    results.rows = {name: [] for name in ("renderers", "speedups", "raster", "reach", "streamed", "blender")}
    keep_large_blocks()
    cars = {"sedan": open_vehicle("sedan"), given.name: given}
    for name, model in cars.items():
        with threads(1):
            measure_car(results, name, model, docs)
        if blender:
            with progress_bar(f"{name}: Cycles", resumes=False) as move:
                results.add("blender", **compare_with_blender(name, model, settings, move))
    summarize(results, list(cars))
    results.picture(partial(save_plot, results), ".svg", "renderer/speed-error.svg")
    results.publish(out, docs, "renderer.md")
    return results


def measure_car(results: Results, name: str, vehicle: Vehicle, docs: Path | None) -> None:
    settings, everyone = results.settings, renderers(results.settings.samples)
    is_main, largest = name == results.figures["main_vehicle"], max(settings.sizes)
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
                if ring_name == "paper" and size == largest:
                    measure_speedup(results, scene)
                    measure_streaming(results, scene)
                    if is_main and docs is not None:
                        save_pictures(scene, renderers((1, 2, 4, 8)), docs / "pictures" / "renderer")
    if is_main:
        measure_reach(results, car)
        if (whole := painted_all_over(vehicle)) is not None:
            measure_rivals(results, f"{name}, painted all over", whole)


def measure_rivals(results: Results, name: str, vehicle: Vehicle) -> None:
    """Algorithms 1 and 2 as they are published: on a car that is textured all over."""
    settings, rivals = results.settings, [*PUBLISHED, ours(2)]
    results.figures["rival_vehicle"] = name
    car, size = Car.of(name, vehicle, settings.uv_size), max(settings.sizes)
    with counted(f"{name}: paper ring, {size} px", settings.views["paper"] + 3 * (settings.repeats + 2)) as moved:
        scene = Scene.of(car, "paper", size, settings, moved)
        measure_scene(results, scene, rivals, moved)
        measure_speedup(results, scene)


def measure_scene(results: Results, scene: Scene, everyone: Sequence[Renderer], moved: Callable[[], None]) -> None:
    """A row per renderer and texture.

    ``forward_ms`` and ``backward_ms`` are per image, the ring as one batch; ``build_ms`` makes one view's taps;
    ``reached`` is the share of the visible paintable texels that receive gradient.
    """
    car, taps, build_ms = scene.car, dict[str, list[Taps]](), dict[str, float]()
    for renderer in everyone:
        views, clock = [], Clock()
        for camera in scene.cameras:
            views.append(renderer.taps(car.vehicle, camera, car.pyramid))
            clock.lap()
        taps[renderer.name], build_ms[renderer.name] = views, float(np.median(clock.laps))
        moved()
    # As in the optimizer, one call serves the batch. Mip levels are paid once per step: see `measure_speedup`.
    texture = car.texture()
    steps = race(
        {name: lambda clock, v=views: timed_step(v, texture, clock) for name, views in taps.items()},  # type: ignore[misc]
        results.settings.repeats,
        moved=moved,
    )
    visible = touched_texels(car.pyramid, [reference.touched for reference in scene.references])
    for renderer in everyone:
        views = taps[renderer.name]
        forward_ms, backward_ms = (np.median(steps[renderer.name], 0) / len(views)).tolist()
        # Pixels without paint only carry their neighbors' texture, in case the light maps need it.
        numbers = [np.diff(view.rows.indptr)[view.alpha > 0] for view in views]
        reached = reached_texels(car.pyramid, views)
        for number, kind in enumerate(TEXTURES):
            results.add(
                "renderers", name=renderer.name, vehicle=car.name, ring=scene.ring, size=scene.size, texture=kind,
                psnr_db=scene.psnr_db(views, number), forward_ms=forward_ms, backward_ms=backward_ms,
                step_ms=forward_ms + backward_ms, build_ms=build_ms[renderer.name],
                taps_per_pixel=mean(float(n.mean()) if len(n) else 0.0 for n in numbers),
                reached=float((reached & visible).sum() / max(visible.sum(), 1)),
            )  # fmt: skip


def measure_reach(results: Results, car: Car) -> None:
    """Share of the texels that a ring of many views shows, at the largest size, to which each gradient comes.

    The paper claims all of them for its sampler; what is not reached keeps its random start and is printed so.
    """
    settings = results.settings
    everyone = [renderer for renderer in renderers(settings.samples) if renderer.samples <= 8]
    cameras = ring(car.vehicle, "paper", settings.reach_views, max(settings.sizes))
    with counted(f"{car.name}: reach of gradients", len(cameras) * (len(everyone) + 1)) as moved:
        touched = []
        for camera in cameras:
            seen = render_reference(car.vehicle, car.caster, camera, car.maps[:1], settings.reference_samples)
            touched.append(seen.touched)
            moved()
        visible = touched_texels(car.pyramid, touched)
        for renderer in everyone:
            reached = np.zeros(len(visible), bool)
            for camera in cameras:
                reached |= reached_texels(car.pyramid, [renderer.taps(car.vehicle, camera, car.pyramid)])
                moved()
            share = float((reached & visible).sum() / max(visible.sum(), 1))
            results.add("reach", name=renderer.name, share=share)


def time_raster(results: Results, scene: Scene, moved: Callable[[], None]) -> None:
    """Our rasterizer against Embree, one sample per pixel: medians over a ring's views.

    ``ours_ms`` includes the vertex transform; ``embree_ms`` is the query alone, rays and tree made beforehand;
    ``trimesh_ms`` the same through trimesh, which copies and normalizes the rays; ``same_face`` is the share of the
    box's pixels for which both name one face.
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

    On the scene's median view by paint shown. ``levels_*_ms`` is UV map to mip levels and back, once per step for any
    batch. ``operator`` is what each image of a large batch gains, ``whole_step`` what a step of a single image does.
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
            gradient = timed_step([taps], texture, clock)
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
    """Read a view's taps from the cache on disk, apply them and their transpose: milliseconds per image."""
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
