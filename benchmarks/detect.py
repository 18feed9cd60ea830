"""``rauca bench detect``: every adapter beside the runtime its network comes from: differences and speed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from rauca_core.contract import Dataset, RaucaError
from rauca_core.detect.weights import listing
from rauca_core.runtime.images import read_image

from . import detect_runtimes as runtimes
from .detect_runtimes import Contender
from .harness import Clock, Results, Settings, counted

FULL = Settings(
    images=20,
    timed=20,  # images per race; the difference is taken on all of them
    framework_images=20,  # all is done on so many where a forward pass takes seconds
    torchvision=(  # architectures with random weights
        "fasterrcnn_mobilenet_v3_large_320_fpn",
        "ssdlite320_mobilenet_v3_large",
        "fasterrcnn_resnet50_fpn",
    ),
    transformers=("Detr", "DeformableDetr", "RTDetr"),
)
QUICK = FULL.but(timed=7, framework_images=3, torchvision=FULL.torchvision[:2], transformers=("DeformableDetr",))

LARGEST_DIFFERENCE = 1e-3
WARM_UPS = 2
USUAL = Path("runs") / "demo" / "held-out"  # the demo's frames, when it has been run here
Maker = Callable[[], Contender]


def bench(out: Path, settings: Settings, docs: Path | None = None, dataset: Path | None = None) -> Results:
    """Measure every standard detector that is ready, and the frameworks' with random weights."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    source, images = choose_images(dataset, settings.images)
    results = Results("detect", settings, {"adapters": [], "missing": []}, {"image_source": source})
    results.figures["milliseconds_are"] = "median CPU time per image on one core"
    contenders = list(_contenders(settings))
    with counted("detectors", len(contenders)) as moved:
        for name, make, count in contenders:
            try:
                measure(results, make(), images[:count], min(settings.timed, count))
            except RaucaError as error:
                results.add("missing", name=name, why=str(error))
            moved(name)
    for entry in listing():
        if entry.source.standard and not entry.ready:
            results.add("missing", name=entry.source.name, why="; ".join(entry.remedies))
    report(results)
    results.publish(out, docs, "detectors.md", width=130)
    return results


def _contenders(settings: Settings) -> Iterator[tuple[str, Maker, int]]:
    for entry in listing():
        if entry.ready and entry.source.standard:
            of_family = runtimes.OF_FAMILY[entry.source.family]
            yield entry.source.name, partial(of_family, entry.source), settings.images
    for maker, names in ((runtimes.torchvision, settings.torchvision), (runtimes.transformers, settings.transformers)):
        for name in names:
            yield name, partial(maker, name), settings.framework_images


def measure(results: Results, contender: Contender, images: list[Tensor], timed: int) -> None:
    """Compare on all images; race on the first ``timed``, in CPU time."""
    fitted = [squared(image, contender.size) for image in images]
    clock = Clock(time.process_time)
    for index in range(WARM_UPS + timed):
        image = fitted[index % len(fitted)]
        prepared = contender.prepare(image)
        clock.restart()
        contender.run(prepared)
        clock.lap()
        contender.forward(image)
        clock.lap()
        contender.backward(image)
        clock.lap()
    kept = np.reshape(clock.laps, (-1, 3))[WARM_UPS:]
    theirs_ms, ours_ms, step_ms = np.median(kept, 0).tolist()
    results.add(
        "adapters",
        name=contender.name,
        reference=contender.reference,
        compared="detections" if contender.thresholds else "predictions",  # after suppression, or before
        images=len(images),
        max_abs_difference=max(contender.differences(image) for image in fitted),
        forward_ms=ours_ms,
        reference_forward_ms=theirs_ms,
        forward_ratio=float(np.median(kept[:, 1] / kept[:, 0])),
        backward_ms=step_ms,
    )


def report(results: Results) -> None:
    columns = {
        "adapter": "{name}", "reference": "{reference}", "compared": "{compared}", "images": "{images}",
        "largest difference": "{max_abs_difference:.1e}", "ours, ms": "{forward_ms:.1f}",
        "theirs, ms": "{reference_forward_ms:.1f}", "ratio": "{forward_ratio:.2f}", "step, ms": "{backward_ms:.1f}",
    }  # fmt: skip
    adapters = results.rows.get("adapters", [])
    title = f"Adapters beside their references, one core, images: {results.figures['image_source']}"
    results.table(title, columns, adapters)
    for what, key, wanted in (
        ("largest difference", "max_abs_difference", LARGEST_DIFFERENCE),
        ("ratio of the forward pass", "forward_ratio", 1.5),
    ):
        if adapters:
            worst = max(adapters, key=lambda row: row[key])
            results.target(f"{what}, worst: {worst['name']}", wanted, worst[key], most=True)
    results.target_table()
    if missing := results.rows.get("missing"):
        results.table("Not measured", {"adapter": "{name}", "why": "{why}"}, missing)


def choose_images(dataset: Path | None, count: int) -> tuple[str, list[Tensor]]:
    """``count`` images (1, 3, H, W) sRGB, frames or drawn, and whence; raises RaucaError where a set has no frames."""
    folder = dataset or (USUAL if (USUAL / "dataset.json").is_file() else None)
    if folder is None:
        return "drawn", [_tensor(draw_street(seed)) for seed in range(count)]
    opened = Dataset(folder)
    frames = opened.frames()
    if not frames:
        raise RaucaError(f"{folder}: holds no frames")
    chosen = [opened.frame_folder(frames[index * len(frames) // count].id) for index in range(count)]
    return folder.name, [_tensor(read_image(place / "image.png").astype(np.float32) / 255) for place in chosen]


def squared(image: Tensor, size: int) -> Tensor:
    """Stretched to the network's square, so that adapter and reference get the same pixels."""
    return functional.interpolate(image, size=(size, size), mode="bilinear", antialias=True).clamp(0, 1)


def _tensor(image_srgb: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(image_srgb.transpose(2, 0, 1)[None]))


def draw_street(seed: int) -> NDArray[np.float32]:
    """A sky, a road and boxes on wheels, with noise: (320, 416, 3) sRGB. Nothing but variety is asked of it."""
    rng = np.random.default_rng(seed)
    canvas = np.empty((320, 416, 3), np.float32)
    horizon = int(rng.integers(120, 180))
    canvas[:horizon] = np.linspace(0.9, 0.6, horizon)[:, None, None] * np.array([0.8, 0.9, 1.0])
    canvas[horizon:] = np.linspace(0.45, 0.25, 320 - horizon)[:, None, None]
    for _ in range(int(rng.integers(2, 5))):
        width = int(rng.integers(40, 160))
        left, foot = int(rng.integers(0, 416 - width)), int(rng.integers(horizon + 20, 310))
        color, height = rng.uniform(0.05, 0.95, 3).tolist(), width // 3
        cv2.rectangle(canvas, (left, foot - height), (left + width, foot), color, -1)
        cv2.rectangle(canvas, (left + width // 5, foot - 2 * height), (left + 4 * width // 5, foot - height), color, -1)
        for wheel in (left + width // 5, left + 4 * width // 5):
            cv2.circle(canvas, (wheel, foot), width // 9, (0.05, 0.05, 0.05), -1)
    canvas += rng.normal(0, 0.03, canvas.shape)
    return canvas.clip(0, 1)
