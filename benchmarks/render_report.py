"""What `rauca bench render` says: tables, targets, a plot, and what each error looks like."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .figures import Line, Panel, save_figure
from .harness import Results, Row
from .render_agreement import premultiplied
from .render_contenders import ALGORITHM_2, Renderer, Scene, ours
from .render_reference import RINGS, TEXTURES

PSNR_DB = {2: 28.0, 4: 35.0, 8: 41.0}  # hoped for, by subsamples per axis


def summarize(results: Results, vehicles: Sequence[str]) -> None:
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


def save_pictures(scene: Scene, everyone: Sequence[Renderer], folder: Path) -> None:
    """The same crop of one view: the reference, and each renderer's result beside its distance from it."""
    view = int(np.argmax([(r.coverage > 0).sum() for r in scene.references]))
    reference = scene.references[view].colors[PHOTOGRAPH]
    window = _busiest(scene.references[view].coverage)
    _save(reference[window], None, folder / "reference.jpg")
    for renderer in everyone:
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
    parts = [np.sqrt(np.clip(linear, 0, 1))]
    if difference is not None:
        parts.append(np.clip(difference * ERROR_GAIN, 0, 1))
    joined = (np.concatenate(parts, 1) * 255).astype(np.uint8).repeat(ZOOM, 0).repeat(ZOOM, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(joined).save(path, quality=80)
