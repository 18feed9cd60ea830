"""``rauca bench motion``: what clips cost, whether light maps hold under motion blur, what warning a paint takes away.

Blur is measured against whole frames of many samples in random paint, moving sideways. Light maps are rendered with the
shutter open, so they are exact for any uniform paint; a texture moves too, so its taps have to be averaged over the
shutter. Both are told: taps of the shutter's middle alone, and of several moments. Under a rolling shutter the moments
are those of bands of rows.
"""

from __future__ import annotations

import importlib.util
import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import torch

import rauca_core as rauca
from pipelines.console import progress_bars
from rauca_core.contract import (
    Camera,
    Clips,
    Dataset,
    Frame,
    Plan,
    Quality,
    Ring,
    find_preset,
    load_camouflage,
    load_vehicle,
)
from rauca_core.contract.clips import MANOEUVRES
from rauca_core.contract.files import write_json
from rauca_core.contract.towns import TEST
from rauca_core.environment import load_exact
from rauca_core.motion.metrics import follow, hota, overlap
from rauca_core.motion.sensor import Sensor
from rauca_core.motion.tracks import Boxes
from rauca_core.render import Pyramid, build_taps, composite, linear_to_srgb, srgb_to_linear
from rauca_core.runtime.devices import threads
from rauca_core.runtime.images import read_image
from rauca_core.study import recipes
from rauca_core.study.candidates import NORMAL, find_vehicles
from rauca_core.study.driven import Drives, measure_drives, save_drives
from rauca_core.study.engine import Engine
from rauca_core.study.evaluate import RandomPaint
from rauca_core.study.makers import CAMOUFLAGE
from rauca_core.study.store import Store
from rauca_core.study.views import HeldOut

from .agreement import SOLID
from .harness import Results, Settings, psnr_db
from .in_blender import children_s, save_weathers

FULL = Settings(
    manoeuvres=MANOEUVRES, frames=20, size=320, samples=4, speed_m_s=10.0, frame_rate=10.0, shutter_s=1 / 120,
    weathers=("clear-day", "low-sun"), blur_size=160, blur_map_samples=16, blur_samples=256, blur_shutter_s=1 / 60,
    readout_s=1 / 60,
    detectors=("yolov3-tiny", "yolov4-tiny", "ssd-mobilenet-v2", "ssd-mobilenet-v3"),
)  # fmt: skip
QUICK = FULL.but(
    manoeuvres=("approach", "cut-in"), frames=10, size=160, speed_m_s=15.0, frame_rate=10.0,
    weathers=("clear-day",), detectors=("yolov3-tiny", "yolov4-tiny"),
)  # fmt: skip
WHOLE_SENSOR = Sensor(0.5, 5000, 4, 8, 85, 0.3, 0.6)
MOMENTS = 7  # of an open or rolling shutter, at which taps are built
BLURRED_M_S = 10.0
BLURRED = ("passing", 4)  # a manoeuvre and how many frames of it; the first and the last only tell the speed
WANTED_DB = 36.0


def bench(out: Path, settings: Settings = FULL, docs: Path | None = None, camouflages: Sequence[str] = ()) -> Results:
    """Measure everything; what is rendered lies beside ``out`` and is used again."""
    results, folder = Results("motion", settings), out.parent / f"{out.stem}-clips"
    _sensor(results)
    if importlib.util.find_spec("trackeval") is not None:
        _metrics(results)
    _blur(results, folder / "blur")
    _warning(results, folder / "study", camouflages)
    results.target_table()
    results.publish(out, docs, "motion.md")
    return results


def _sensor(results: Results) -> None:
    """CPU time of a frame of 320 px on one thread, beyond that of sRGB encoding, which happens anyway."""
    light = torch.rand(1, 3, 320, 320) * 0.6
    with threads(1):
        bare, whole = (_milliseconds(partial(sensor, light)) for sensor in (Sensor(), WHOLE_SENSOR))
    results.figures["sensor_ms"] = whole - bare
    results.target("sensor, a frame of 320 px", 2.0, whole - bare, "ms", most=True)


def _milliseconds(work: Callable[[], object], times: int = 40) -> float:
    taken = []
    for _ in range(times):
        began = time.thread_time()
        work()
        taken.append(time.thread_time() - began)
    return 1e3 * min(taken)


def _metrics(results: Results) -> None:
    """The largest difference of HOTA from `trackeval`'s on random tracks."""
    import trackeval

    worst = 0.0
    for seed in range(20):
        truth, tracks = random_tracks(seed)
        theirs = trackeval.metrics.HOTA().eval_sequence(as_trackeval(truth, tracks))["HOTA"].mean()
        worst = max(worst, abs(hota(truth, tracks).hota - float(theirs)))
        assert follow(truth, tracks)
    results.figures["hota_difference"] = worst
    results.target("HOTA's difference from trackeval", 1e-9, worst, most=True)


def random_tracks(seed: int, frames: int = 40) -> tuple[list[Boxes], list[Boxes]]:
    """Four things that move, and a tracker that misses, shakes and takes one for another."""
    rng = np.random.default_rng(seed)
    start, speed, names = rng.uniform(0, 80, (4, 2)), rng.uniform(-2, 2, (4, 2)), np.arange(4)
    truth, tracks = [], []
    for frame in range(frames):
        boxes = np.concatenate([start + frame * speed, start + frame * speed + 20], 1)
        truth.append(Boxes(boxes, np.arange(4)))
        names = rng.permutation(6)[:4] if rng.random() < 0.1 else names
        found = rng.random(4) < 0.7
        tracks.append(Boxes(boxes[found] + rng.normal(0, 2, (int(found.sum()), 4)), names[found]))
    return truth, tracks


def as_trackeval(truth: Sequence[Boxes], tracks: Sequence[Boxes]) -> dict[str, object]:
    """Frames as `trackeval` takes them: ids counted from 0 without holes."""
    told: dict[str, object] = {"num_timesteps": len(truth)}
    for name, frames in (("gt", truth), ("tracker", tracks)):
        ids = sorted({int(i) for boxes in frames for i in boxes.values})
        told[f"{name}_ids"] = [np.array([ids.index(int(i)) for i in boxes.values], int) for boxes in frames]
        told[f"num_{name}_ids"], told[f"num_{name}_dets"] = len(ids), sum(map(len, frames))
    told["similarity_scores"] = [overlap(t.xyxy, p.xyxy) for t, p in zip(truth, tracks, strict=True)]
    return told


def _blur(results: Results, folder: Path) -> None:
    """Light maps under blur against a blurred render of the painted car; with the shutter shut and rolling, too."""
    settings, (sedan,) = results.settings, find_vehicles(["sedan"])
    body, (weather,) = recipes.vehicle_in(sedan.folder), find_preset("single")[:1]
    with progress_bars() as on_progress:
        engine = Engine(Store(folder), on_progress=on_progress)
        (painted,) = engine.make(recipes.random_paint(body, 1024, 1, 8))
        paint = recipes.camouflage_in(painted / CAMOUFLAGE, "random")
        for shutter_s, readout_s in ((0.0, 0.0), (0.0, settings.readout_s), (settings.blur_shutter_s, 0.0)):
            clips = Clips((BLURRED[0],), BLURRED[1], BLURRED_M_S, 15.0, shutter_s, readout_s)
            plan = Plan.of(
                (weather,), Ring((0.0,), (0.0,), (8.0,)), clips=clips, size=settings.blur_size, min_visible=0.0,
                quality=Quality(settings.blur_map_samples), seed=TEST["held-out clips"], vehicle_name=sedan.name,
                atlas_id=sedan.atlas_id,
            )  # fmt: skip
            ids = [frame.id for frame in plan.frames()]
            views = recipes.data_set(f"blur-{shutter_s:.3f}-{readout_s:.3f}", plan, body, ids)
            data, rendered = engine.make(views, recipes.renders(views, paint, ids[1:-1], settings.blur_samples))
            for moments in (1, MOMENTS) if clips.open_s else (1,):
                found = inside_db(Dataset(data), painted / CAMOUFLAGE, rendered, clips, moments)
                results.add("blur", shutter_s=shutter_s, readout_s=readout_s, moments=moments, inside_db=found)
    rows = results.rows["blur"]
    results.figures["blur_db"] = rows[-1]["inside_db"]
    results.target("light maps under blur, inside the paint", WANTED_DB, rows[-1]["inside_db"], "dB")
    columns = {
        "shutter, s": "{shutter_s:.4f}", "readout, s": "{readout_s:.4f}", "moments of taps": "{moments}",
        "inside, dB": "{inside_db:.1f}",
    }  # fmt: skip
    results.table("Error of light maps under motion blur, against a blurred render of the painted car", columns, rows)


def inside_db(dataset: Dataset, camouflage: Path, renders: Path, clips: Clips, moments: int) -> float:
    """PSNR of predicted frames inside the paint, display space, over a clip's frames but the first and the last.

    Args:
        clips: whose shutter is open or rolls, not both.
        moments: of the open shutter, over which the texture's taps are averaged by coverage; or of a rolling one, of
            which each is that of a band of rows.
    """
    vehicle = load_vehicle(dataset.vehicle_folder, read_image)
    record, image = load_camouflage(camouflage)
    pyramid = Pyramid.of(vehicle, record.size)
    uv_map = torch.from_numpy(read_image(image).astype(np.float32) / 255).permute(2, 0, 1)
    texels = pyramid(srgb_to_linear(pyramid.from_map(uv_map)))
    later = ((np.arange(moments) + 0.5) / moments - 0.5) * clips.open_s
    frames, errors = dataset.frames(), []
    for before, frame, after in zip(frames, frames[1:], frames[2:], strict=False):
        pixels = dataset.plan.size**2
        shown, share = torch.zeros(pixels, 3), torch.zeros(pixels, 1)
        for band, moment in enumerate(later.tolist()):
            taps = build_taps(vehicle, seen_at(before, frame, after, moment), pyramid.size, 12, pyramid=pyramid)
            covered = torch.from_numpy(taps.coverage().astype(np.float32)).reshape(-1, 1)
            if clips.readout_s:
                covered *= torch.arange(pixels)[:, None] // dataset.plan.size * moments // dataset.plan.size == band
            place = torch.from_numpy(taps.pixels.astype(np.int64))
            shown.index_add_(0, place, covered[place] * taps.rows(texels))
            share += covered
        light = load_exact(dataset, frame.id)
        A, B = (torch.from_numpy(one.reshape(-1, 3)) for one in (light.A, light.B))
        predicted = linear_to_srgb(composite(shown / share.clamp(min=1e-6), A, B)).numpy()
        rendered = read_image(renders / f"{frame.id}.png").reshape(-1, 3) / np.float32(255)
        inside = read_image(dataset.frame_folder(frame.id) / "paint.png").ravel() / 255 > SOLID
        errors.append((rendered - predicted)[inside] ** 2)
    return psnr_db(np.concatenate(errors))


def seen_at(before: Frame, frame: Frame, after: Frame, later_s: float) -> Camera:
    """The camera in the vehicle's frame a little after a frame's time, on a straight way without a turn."""
    one, here, two = (some.camera_in_vehicle for some in (before, frame, after))
    speed = (two.t - one.t) / (after.time_s - before.time_s)
    return Camera(here.K, here.R, here.t + later_s * speed, here.width, here.height)


def _warning(results: Results, folder: Path, camouflages: Sequence[str]) -> None:
    """The study of clips, all weathers in one set: figures by paint and detector, and the CPU time of a frame."""
    s = results.settings
    clips = Clips(tuple(s.manoeuvres), s.frames, s.speed_m_s, s.frame_rate, s.shutter_s)
    weathers = folder.parent / f"{'+'.join(s.weathers)}.json"
    save_weathers(weathers, [weather for weather in find_preset("demo") if weather.name in s.weathers])
    with _measured(results, folder), progress_bars() as on_progress:
        study = rauca.evaluate(
            list(camouflages), list(s.detectors), out=folder, vehicle="sedan", weathers=[str(weathers)],
            views=HeldOut.driven(clips, s.size, s.samples), random=RandomPaint(), on_progress=on_progress,
        )  # fmt: skip
    drives = measure_drives(study)
    save_drives(folder, drives)
    _tell(results, drives)


@contextmanager
def _measured(results: Results, folder: Path) -> Iterator[None]:
    """Tell the CPU time of a rendered frame, plain or painted; kept beside the study, where a resumed run adds its own.

    Of a run that was killed neither time nor frames count.
    """
    kept = folder / "cpu.json"
    before, had, began = json.loads(kept.read_text()) if kept.is_file() else {}, _rendered(folder), children_s()
    yield
    used = {
        "cpu_s": before.get("cpu_s", 0.0) + children_s() - began,
        "frames": before.get("frames", 0) + _rendered(folder) - had,
    }
    write_json(kept, used)
    if used["frames"]:
        results.figures["clip_cpu_s_per_frame"] = used["cpu_s"] / used["frames"]


def _rendered(folder: Path) -> int:
    """Frames of a study's data sets and camouflages."""
    store = folder / "store"
    return sum(1 for _ in store.glob("views/*/frames/*")) + sum(1 for _ in store.glob("renders/*/**/*.png"))


def _tell(results: Results, drives: Drives) -> None:
    rows = []
    for row in drives.rows:
        told = {name: value for name, value in row.to_json().items() if name not in ("lost_m", "lost_s")}
        results.add("warning", **told, warning_lost_m=row.lost_m.to_json(), warning_lost_s=row.lost_s.to_json())
        lost = {
            name: f"{mean.value:.2f}" + ("" if mean.low is None else f" ({mean.low:.1f} to {mean.high:.1f})")
            for name, mean in (("lost_m", row.lost_m), ("lost_s", row.lost_s))
        }
        blind = "" if row.blind is None else f"{row.blind:.0%}"
        rows.append({**told, **lost, "blind": blind})
    columns = {
        "detector": "{detector}", "paint": "{paint}", "AP@0.5": "{ap:.3f}", "warning lost, m": "{lost_m}",
        "warning lost, s": "{lost_s}", "longest gap, s": "{gap_s:.2f}", "blind while braking": "{blind}",
        "breaks": "{breaks}", "other track": "{switches}", "HOTA": "{hota:.3f}",
    }  # fmt: skip
    clips = drives.rows[0].clips
    results.table(f"{clips} clips, tracked by {drives.tracker}; in brackets: 95 % interval over clips", columns, rows)
    results.figures["warning_lost_m"] = {
        f"{row.paint}, {row.detector}": row.lost_m.to_json() for row in drives.rows if row.paint != NORMAL
    }
