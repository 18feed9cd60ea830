"""What `rauca bench environment` says: tables, targets, a plot and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import mean, median

import numpy as np

from rauca_core.environment import LightSplitter
from rauca_core.environment.estimate import estimate
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import splitter_render
from rauca_core.environment.metrics import Error, total

from .environment_truth import SATURATED, Truth, displayed
from .figures import Line, Panel, save_figure, save_sheet
from .harness import Results, Row

NOON = "sun90-fog0"
TEXTURE = "texture"  # the method whose gain is the irradiance texture's
TARGETS_DB = {NOON: 40, "sun30-fog90": 40, "sun-90-fog0": 38}  # of exact maps inside the paint


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


def summarize(results: Results) -> None:
    _method_tables(results)
    _training_tables(results)
    _exact_targets(results)
    names = ("ours", "published")
    for what, wanted, (ours, published) in (
        ("MSE", 0.5, [error_of(results, name).mse for name in names]),
        ("time", 0.25, [_cpu_ms(results, name) for name in names]),
        ("parameters", 0.25, [results.one("training", name=name)["parameters"] for name in names]),
    ):
        results.target(f"our {what} over the published", wanted, ours / published, most=True)
    times = results.figures["epoch_time"]
    for loop, wanted in (("final", 13), ("ours", 20)):
        results.target(f"epoch, base over {loop}", wanted, times["base_s"] / times[f"{loop}_s"])
    for row in results.rows.get("vehicles", []):
        name, ratio = row["vehicle"], row["epochs_pretrained"] / row["epochs_scratch"]
        results.target(f"{name}: epochs pre-trained over from scratch, the paper's criterion", 0.2, ratio, most=True)
        if row["near_scratch"] and row["near_pretrained"] is not None:
            ratio = row["near_pretrained"] / row["near_scratch"]
            results.target(f"{name}: the same, to 5 % of the error from scratch", 0.2, ratio, most=True)
        results.target(f"{name}: fine-tuned, unseen weather", 28, row["after_db"], "dB")
    results.target_table()


def summarize_maps(results: Results) -> None:
    """Exact maps and irradiance textures alone."""
    _maps_table(results)
    _exact_targets(results)
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
    rows = [{"weather": w, **{name: error_of(results, name, [w]) for name in methods}} for w in weathers]
    results.table("PSNR by weather, dB", {"weather": "{weather}", **by_method}, rows)
    _maps_table(results)
    rows = [{"texture": t, **{name: error_of(results, name, texture=t) for name in methods}} for t in textures]
    results.table("PSNR by texture, dB", {"texture": "{texture}", **by_method}, rows)


def _maps_table(results: Results) -> None:
    rows = []
    for weather in dict.fromkeys(row["weather"] for row in results.where("errors", data="defaults")):
        maps, textures = (_exact(results, weather, method) for method in ("exact", TEXTURE))
        row = {f"maps_{region}": error.psnr_db for region, error in maps.items()}
        rows.append({"weather": weather, **row, **{f"texture_{r}": error.psnr_db for r, error in textures.items()}})
    columns = {
        "weather": "{weather}", "maps, inside": "{maps_inside:.1f}", "edges": "{maps_edge:.1f}",
        "texture, inside": "{texture_inside:.1f}", "edges ": "{texture_edge:.1f}",
    }  # fmt: skip
    settings = results.settings
    what = f"Exact maps of {settings.samples} samples at {settings.exact_size} px"
    results.table(f"{what}, and with the texture of {settings.exact_azimuths} views, dB", columns, rows)


def _exact(results: Results, weather: str, method: str = "exact") -> dict[str, Error]:
    """Exact maps at the data set's default size and budget."""
    return {r: error_of(results, method, [weather], "defaults", r) for r in ("inside", "edge")}


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
    loops = {"published": "base {base_s:.2f}, final {final_s:.2f}", "ours": "{ours_s:.2f}"}
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
    for method, told in (("exact", "exact maps"), (TEXTURE, "irradiance texture")):
        found = {w: _exact(results, w, method) for w in weathers}
        inside, edges = ({w: found[w][region].psnr_db for w in weathers} for region in ("inside", "edge"))
        for weather, wanted in TARGETS_DB.items():
            if weather in inside:
                results.target(f"{told} inside the paint, {weather}", wanted, inside[weather], "dB")
        results.target(f"{told} inside the paint, worst weather", 35, min(inside.values()), "dB")
        if NOON in edges:
            results.target(f"{told} on edges, {NOON}", 36, edges[NOON], "dB")
        results.target(f"{told} on edges, worst weather", 32, min(edges.values()), "dB")
    if len(results.settings.budgets) > 1 and "curve" in results.rows:
        gap = min(_gap(results.where("curve", weather=weather)) for weather in weathers)
        results.target("exact maps over the car itself at equal time, worst weather", 0, gap, "dB")


def _gap(curve: Sequence[Row]) -> float:
    """Least of the maps' PSNR, less that of rendering the car for the same time."""
    rows = sorted(curve, key=lambda row: float(row["samples"]))
    seconds, db = [np.log(row["render_s"]) for row in rows], [row["render_db"] for row in rows]
    return min(row["maps_db"] - float(np.interp(np.log(row["maps_s"]), seconds, db)) for row in rows)


def save_curve(results: Results, path: Path) -> None:
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


ERROR_GAIN = 4


def save_figure_of_maps(
    frames: LightFrames, truths: Sequence[Truth], net: LightSplitter, weathers: Sequence[str], path: Path
) -> None:
    """A row per weather: reference, A, B, the textured car as our extractor lights it, the truth, the error."""
    rows = {}
    for weather in weathers:
        truth = next(t for t in truths if t.texture == SATURATED and frames.get(t.index).weather == weather)
        frame = frames.get(truth.index)
        light = estimate(frames.datasets[0], frames.places[truth.index].frame.id, net)
        seen = splitter_render(net, frame)(truth.albedo)[0]
        paint, reference = frame.paint > 0, frame.image / 255
        # The truth was rendered around the paint only; the rest of the frame is the data set's own.
        rendered = (truth.first + truth.second) / 2 * paint + reference * ~paint
        error = ((seen - rendered).abs() * paint * ERROR_GAIN).clamp(max=1.0)
        A, B = (displayed(m) for m in (light.A, light.B))
        shown = {"reference": reference, "A": A, "B": B, "rendered": seen, "Cycles": rendered, "error": error}
        rows[weather] = {name: image.permute(1, 2, 0).detach().numpy() for name, image in shown.items()}
    save_sheet(path, rows)
