"""Readers of what rauca itself writes as JSON, lines, images and arrays."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from rauca_core.attack import read_history
from rauca_core.attack.naturalness.palette import read_palette
from rauca_core.contract import (
    Camouflage,
    Dataset,
    find_preset,
    load_camouflage,
    load_frame,
    load_passes,
    load_vehicle,
    parse_optimize_progress,
    parse_progress,
    planned_frames,
    read_ledger,
    save_camouflage,
    save_frame,
)
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import png_bytes, write_sums
from rauca_core.contract.reading import read_limited
from rauca_core.dataset_tools.check import check_ledgers
from rauca_core.dataset_tools.check_frame import checksums
from rauca_core.runtime.images import read_image
from rauca_core.study.detection_cache import DetectionCache, DetectionSettings
from rauca_core.study.results import load_results
from rauca_core.study.study import load_study
from tests.contract.samples import PLAN, a_frame, some_passes

from .mutate import mutate_json, mutate_lines, mutate_text
from .target import Target, json_lines

FRAME = "L00-V000-day"
ESTIMATE = {"ap": 0.5, "low": 0.4, "high": 0.6}
RESULTS = {
    "format": "rauca-results", "version": 5, "dataset": "d",
    "settings": {"category": "car", "score_threshold": 0.005, "other_threshold": 0.1, "iou_threshold": 0.45},
    "detectors": {"one": "abc"}, "dropped": ["x"],
    "frames": [
        {"id": FRAME, "weather": "day", "azimuth_deg": 0.0, "elevation_deg": 10.0, "distance_m": 5.0,
         "sun_altitude_deg": 45.0, "fog_density": 0.0, "box_xyxy": [1.0, 2.0, 3.0, 4.0], "location": 0, "view": 0}
    ],
    "table": {"normal": {"one": ESTIMATE}},
    "groups": {
        axis: [{"value": 0.0, "frames": 1, "ap": {"normal": {"one": 0.5}}}]
        for axis in ("azimuth_deg", "elevation_deg", "distance_m", "sun_altitude_deg", "fog_density")
    },
    "images": {"normal": [{"path": "a.png", "sha256": "0" * 64}]}, "detections": {"normal": {"one": "detections"}},
    "vehicle": "box", "defence": "none", "place_kind": "frames", "place_count": 1,
}  # fmt: skip
STUDY = {
    "format": "rauca-study", "version": 2, "command": "x",
    "entries": [
        {"weathers": "seen", "defence": "none", "vehicle": "box", "category": "car", "results": "seen/results.json",
         "views": "seen/views", "camouflages": {"rauca": "c.json"}, "parts": {"took no part": ["one"]}}
    ],
}  # fmt: skip
LEDGER = json_lines(
    {"frame": FRAME, "state": "done", "seconds": 1.5},
    {"frame": "L01-V001-fog", "state": "occluded", "visible": 0.1},
    {"frame": "L01-V000-fog", "state": "failed", "reason": "lost"},
)
STEP = {"loss": 0.5, "attack": 0.5, "smooth": 0.1, "score": 0.9, "seconds": 1.0}
HISTORY = json_lines(*({"step": i, "steps": 3, **STEP, "prior": 0.0, "stages": {}} for i in (1, 2, 3)))
PROGRESS = 'rauca-progress {"done": 1, "total": 2, "last": "x", "left_s": 1.0}\n'
PROGRESS += json_lines({"step": 1, "of": 2, **STEP, "left_s": 1.0, "preview": "a.png", "uv_map": "b.png"})
FOUND = {"image": "0" * 64, "boxes": [[1.0, 2.0, 3.0, 4.0]], "scores": [0.9], "names": ["car"]}
NOON = {"name": "noon", "sun_altitude_angle": 75.0, "fog_density": 10.0, "cloudiness": 5.0, "dust_storm": 1.0}
WEATHERS = {"format": "rauca-weathers", "version": 1, "convention": "carla", "weathers": [NOON]}
PALETTE = "#102030\n#a0b0c0, #ffffff\n#000000\n"
DETECTIONS = DetectionCache(Path("nowhere"), "one", "abc", DetectionSettings()).path.name


def _frame(folder: Path) -> None:
    save_frame(folder / FRAME, a_frame(), some_passes())


def _read_frame(folder: Path) -> None:
    load_frame(folder / FRAME)
    load_passes(folder / FRAME)


def _png(folder: Path) -> None:
    (folder / "image.png").write_bytes(png_bytes(np.arange(12 * 9 * 3, dtype=np.uint8).reshape(12, 9, 3)))


def _jpeg(folder: Path) -> None:
    Image.fromarray(np.arange(24 * 16 * 3, dtype=np.uint32).astype(np.uint8).reshape(24, 16, 3)).save(
        folder / "image.jpg", quality=60
    )


def _camouflage(folder: Path) -> None:
    record = Camouflage("name", "box", "abc", 4, "rauca", {"steps": 3})
    save_camouflage(folder / "c.json", record, png_bytes(np.zeros((4, 4, 3), np.uint8)))


def _vehicle(folder: Path) -> None:
    load_vehicle(assets_folder() / "vehicles" / "cube", read_image).save(folder / "cube")


def _sums(folder: Path) -> None:
    for name in ("a.txt", "b.txt"):
        (folder / name).write_text(name)
    write_sums(folder, ["a.txt", "b.txt"])


def _study(folder: Path) -> None:
    (folder / "seen").mkdir(exist_ok=True)
    (folder / "seen" / "results.json").write_text(json.dumps(RESULTS))
    (folder / "study.json").write_text(json.dumps(STUDY))


def _read_ledger(folder: Path) -> None:
    read_ledger(folder)
    list(check_ledgers(folder, {FRAME, "L01-V001-fog"}, {FRAME}))


def _read_sums(folder: Path) -> None:
    found: list[str] = []
    checksums(lambda file, what: found.append(f"{file}: {what}"), folder)


def _read_progress(folder: Path) -> None:
    for line in read_limited(folder / "lines", 2**20).decode(errors="replace").splitlines():
        parse_progress(line)
        parse_optimize_progress(line)


def _read_vehicle(folder: Path) -> None:
    load_vehicle(folder / "cube", read_image)


def _read_cache(folder: Path) -> None:
    DetectionCache(folder, "one", "abc", DetectionSettings())


TARGETS = (
    Target("plan", "dataset.json", json.dumps(PLAN.to_json()), lambda f: planned_frames(Dataset(f).plan), mutate_json),
    Target("frame-json", f"{FRAME}/frame.json", _frame, _read_frame, mutate_json),
    Target("frame-npz", f"{FRAME}/passes.npz", _frame, _read_frame),
    Target("vehicle-json", "cube/vehicle.json", _vehicle, _read_vehicle, mutate_json),
    Target("vehicle-npz", "cube/mesh.npz", _vehicle, _read_vehicle),
    Target("png", "image.png", _png, lambda f: read_image(f / "image.png")),
    Target("jpeg", "image.jpg", _jpeg, lambda f: read_image(f / "image.jpg")),
    Target("camouflage", "c.json", _camouflage, lambda f: load_camouflage(f / "c.json"), mutate_json),
    Target("ledger", "ledger.jsonl", LEDGER, _read_ledger, mutate_lines),
    Target("checksums", "SHA256SUMS", _sums, _read_sums, mutate_text),
    Target("results", "seen/results.json", _study, lambda f: load_results(f / "seen/results.json"), mutate_json),
    Target("study", "study.json", _study, load_study, mutate_json),
    Target("history", "history.jsonl", HISTORY, read_history, mutate_lines),
    Target("detections", DETECTIONS, json_lines(FOUND, FOUND), _read_cache, mutate_lines, writes=True),
    Target("weathers", "w.json", json.dumps(WEATHERS), lambda f: find_preset(str(f / "w.json")), mutate_json),
    Target("palette", "p.txt", PALETTE, lambda f: read_palette(str(f / "p.txt"), 4), mutate_text),
    Target("progress", "lines", PROGRESS, _read_progress, mutate_lines),
)
