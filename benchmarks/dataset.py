"""``rauca bench dataset``: what a frame costs and how far it is from the converged one.

`dataset_in_blender.py` measures in a process of its own; here is what is made of its figures.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blender_addon.scene.composed_fog import DENSEST, THINNEST
from pipelines.console import progress_bar
from rauca_core.contract.color import linear_to_srgb

from .figures import Line, Panel, save_figure
from .harness import Results, Row, Settings
from .in_blender import run_child

FULL = Settings(
    size=320,  # of the square frames, pixels
    views=(1, 26),  # of the default ring, on which errors are measured: near and low, far and high
    reference_samples=80,  # per pixel of each of the reference's two halves
    single_samples=(1, 2, 4, 8, 16, 32),  # per pixel, of denoised renders of one color
    raw_samples=(8,),  # the same without the denoiser, for renders and light maps alike
    map_samples=(2, 4, 8, 16),  # per pixel, of denoised light maps
    thresholds=(0.02, 0.05, 0.1),  # of adaptive sampling, with at most ``adaptive_samples``
    adaptive_samples=64,
    bounces=(1, 2, 12),  # other numbers of them
    fog_densities=(25.0, 50.0, 75.0, 90.0),  # of the curve of composed fog, by day and by night
    fog_samples=32,  # per pixel of each half of the curve's references
    sets=(("base", (1, 26)), ("enhanced", (26,))),  # weather presets rendered whole, and the views of each
)
QUICK = FULL.but(
    views=(26,),
    reference_samples=16,
    single_samples=(2, 4, 8, 16),
    map_samples=(4, 8),
    thresholds=(0.05,),
    bounces=(1,),
    fog_densities=(50.0,),
    fog_samples=12,
    sets=(("base", (26,)),),
)

KINDS = ("clear", "foggy", "night")
SINGLE, MAPS = "one render", "light maps"  # of one color; that serve every color
MAIN_SET = "base"  # whose speed is the headline; the others are listed
COLORS = 9  # that share a frame's light maps, in the paper's set
METHODS = {"real": "real volume", "composed": "composed around the vehicle", "everywhere": "composed everywhere",
           "formula": "transmittance and airlight"}  # fmt: skip
PSNR_DB = {"clear": 35.0, "foggy": 33.0, "night": 33.0}
COMPOSED_DB = 35.0
SPEEDUP = 10.0
Image = NDArray[np.float32]


class Halves(NamedTuple):
    """Two independent renders of one frame, (H, W, 3) linear, without the denoiser."""

    first: Image
    second: Image


def squared_errors(found: Image, reference: Halves, painted: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Mean square errors of display values, of linear light up to display white, of display values on the paint.

    The error against one half times the error against the other: their noise is independent and averages out.
    """
    display = _product(linear_to_srgb(found), *(linear_to_srgb(half) for half in reference))
    linear = _product(np.clip(found, 0, 1), *(np.clip(half, 0, 1) for half in reference))
    paint = float(display[painted].mean()) if painted.any() else 0.0
    return float(display.mean()), float(linear.mean()), paint


def _product(found: NDArray[np.floating], first: NDArray[np.floating], second: NDArray[np.floating]) -> Image:
    return ((found - first).astype(np.float64) * (found - second)).astype(np.float32)


def naive_samples(entries: Sequence[Row]) -> int:
    """Samples of one denoised render whose PSNR equals that of the default light maps, the first of ``entries``.

    Between measured counts the PSNR goes with the logarithm of the samples; rounded down, in the rival's favor.
    """
    ours = next(entry for entry in entries if entry["what"] == MAPS)
    rival = sorted((e["samples"], e["psnr_db"]) for e in entries if e["what"] == SINGLE and e["axis"] == "samples")
    counts, psnrs = zip(*rival, strict=True)
    rising = np.maximum.accumulate(psnrs)
    return max(1, math.floor(2 ** float(np.interp(ours["psnr_db"], rising, np.log2(counts))) + 1e-6))


def bench(out: Path, settings: Settings, docs: Path | None = None) -> Results:
    """Measure the default data set; raises :class:`RaucaError` where Blender is missing, or died."""
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary, progress_bar("data set") as move:
        found = Path(temporary) / "found.json"
        run_child("dataset_in_blender.main", {"settings": vars(settings), "out": str(found)}, move)
        results = Results("dataset", settings, **json.loads(found.read_text()))
    summarize(results)
    results.picture(partial(save_pareto, results), ".svg", "datasets/cost-error.svg")
    results.picture(partial(save_fog_curve, results), "-fog.svg", "datasets/composed-fog.svg")
    results.publish(out, docs, "speed.md", width=170)
    return results


def summarize(results: Results) -> None:
    presets = results.distinct("sets", "preset")
    main = results.where("sets", preset=MAIN_SET if MAIN_SET in presets else presets[0])
    frames = sum(row["frames"] for row in main)
    defaults = {kind: results.one("entries", kind=kind, what=MAPS) for kind in KINDS}
    results.figures |= {
        "seconds_are": "CPU seconds of all threads, per frame in one color",
        "default_seconds_per_frame": sum(row["ours_s"] for row in main) / frames,
        "naive_seconds_per_frame": sum(row["naive_s"] for row in main) / frames,
        "speedup_vs_naive": _speedup(main),
    }
    for kind, row in defaults.items():
        results.target(f"default frames, {kind}", PSNR_DB[kind], row["psnr_db"], "dB")
    if results.figures["default"]["composed_fog"]:
        for row in results.where("fog_curve", light="day"):
            if THINNEST <= row["extinction"] <= DENSEST:  # for which composing is done
                density = f"composed fog, density {row['fog_density']:g}"
                results.target(density, COMPOSED_DB, row["composed_db"], "dB")
    for preset in presets:
        speedup = _speedup(results.where("sets", preset=preset))
        results.target(f"times as fast as naive, {preset}", SPEEDUP, speedup, "times")
    results.target_table()
    _sweep_table(results)
    sets = [
        row | {"samples": ", ".join(f"{k} {n}" for k, n in row["naive_samples"].items()),
               "per_frame_s": row["ours_s"] / row["frames"]}
        for row in results.rows["sets"]
    ]  # fmt: skip
    columns = {
        "preset": "{preset}", "view": "{view}", "frames": "{frames}", "ours, CPU s": "{ours_s:.1f}",
        "per frame": "{per_frame_s:.3f}", "naive, CPU s": "{naive_s:.1f}", "its samples": "{samples}",
        "times": "{speedup:.1f}",
    }  # fmt: skip
    results.table("Whole sets in nine colors, of one view", columns, sets)
    columns = {"light": "{light}", "density": "{fog_density:g}", "extinction, 1/m": "{extinction:.4f}"}
    columns |= {f"{label}, dB": f"{{{method}_db:.1f}}" for method, label in METHODS.items()}
    results.table("Composed fog", columns, results.rows["fog_curve"])


def _speedup(sets: Sequence[Row]) -> float:
    return float(sum(row["naive_s"] for row in sets) / sum(row["ours_s"] for row in sets))


def _sweep_table(results: Results) -> None:
    figures = {
        "dB": "psnr_db:.1f", "linear": "linear_psnr_db:.1f", "paint": "paint_psnr_db:.1f", "CPU s": "cpu_seconds:.2f",
    }  # fmt: skip
    columns = {f"{kind}, {head}": f"{{{kind} {head}}}" for kind in KINDS for head in figures}
    empty = {f"{kind} {head}": "" for kind in KINDS for head in figures}
    rows: dict[str, Row] = {}
    for entry in results.rows["entries"]:
        row = rows.setdefault(_name(entry), {"what": _name(entry), **empty})
        row |= {f"{entry['kind']} {head}": f"{{{form}}}".format(**entry) for head, form in figures.items()}
    title = "Error and cost of a render, and of the light maps that serve every color"
    results.table(title, {"what": "{what}", **columns}, rows.values())


def _note(entry: Row) -> str:
    """What sets an entry apart within its series."""
    notes = {
        "adaptive": f"≤{entry['adaptive_threshold']:g}",
        "bounces": f"{entry['bounces']} bounces",
        "fog": "composed" if entry["composed_fog"] else "real",
    }
    return notes.get(entry["axis"], str(entry["samples"]))


def _name(entry: Row) -> str:
    """Says in words what a variant is."""
    words = {"adaptive": "adaptive, noise {}", "fog": "fog {}", "bounces": "{}", "raw": "{} samples, raw"}
    return f"{entry['what']}, {words.get(entry['axis'], '{} samples').format(_note(entry))}"


def save_pareto(results: Results, path: Path) -> None:
    series = (
        ("one render a color, denoised", SINGLE, "samples", {"color": "C0"}, 1),
        (f"light maps, {COLORS} colors, denoised", MAPS, "samples", {"color": "C1"}, COLORS),
        ("one render a color, raw", SINGLE, "raw", {"color": "C7", "marker": "s"}, 1),
        ("light maps, raw", MAPS, "raw", {"color": "C5", "marker": "s"}, COLORS),
        ("light maps, adaptive", MAPS, "adaptive", {"color": "C2", "marker": "^"}, COLORS),
        ("light maps", MAPS, "bounces", {"color": "C4", "marker": "v"}, COLORS),
        ("light maps, fog the other way", MAPS, "fog", {"color": "C6", "marker": "D"}, COLORS),
    )
    panels = []
    for kind in KINDS:
        lines = []
        for label, what, axis, style, shared_by in series:
            chosen = results.where("entries", kind=kind, what=what, axis=axis)
            curve = axis == "samples"  # with a note at each point; the others lie close together: the legend has theirs
            noted = "by samples" if curve else ", ".join(dict.fromkeys(map(_note, chosen)))
            drawn = style if curve else {**style, "linestyle": ""}
            points = [(e["cpu_seconds"] / shared_by, e["psnr_db"], _note(e) if curve else "") for e in chosen]
            lines += [Line(f"{label}, {noted}", sorted(points), drawn)] if points else []
        default = results.one("entries", kind=kind, what=MAPS)
        star = {"marker": "*", "color": "C3", "markersize": 13, "linestyle": ""}
        lines.append(Line("default", [(default["cpu_seconds"] / COLORS, default["psnr_db"], "")], star))
        panels.append(Panel(kind, lines, PSNR_DB[kind]))
    x, y = "CPU seconds per frame in one color", "PSNR against a converged render, display values, dB"
    save_figure(path, panels, x, y)


def save_fog_curve(results: Results, path: Path) -> None:
    panels = []
    for light in results.distinct("fog_curve", "light"):
        rows = results.where("fog_curve", light=light)
        lines = [
            Line(label, sorted((row["extinction"], row[f"{method}_db"], "") for row in rows))
            for method, label in METHODS.items()
        ]
        panels.append(Panel(light, lines, COMPOSED_DB))
    save_figure(path, panels, "extinction, 1/m", "PSNR, display values, dB")
