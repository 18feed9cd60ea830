"""``rauca bench defences``: what they cost, do to clean pictures, and save."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from rauca_core.attack.losses import attack_loss
from rauca_core.contract import Dataset, RaucaError
from rauca_core.detect import Detector, class_index, load_detector
from rauca_core.study.average_precision import Sample, average_precision
from rauca_core.study.defences import KINDS, NO_DEFENCE, Defence, make_defence
from rauca_core.study.defences.informed import DefendedDetector
from rauca_core.study.defences.nutnet import NutNet, trained
from rauca_core.study.detecting import read_frame_image

from .figures import save_sheet
from .harness import Results, Settings, counted
from .vehicle import car_score

FULL = Settings(
    steps=120,  # of the patch's optimization
    views=10**6,  # at most, that are measured
)
QUICK = FULL.but(steps=20, views=8)

ALTERED = 16 / 255
BATCH = 6
LOW_SCORE, NMS_IOU = 0.005, 0.45  # as `rauca evaluate` has them
INFORMED = "informed"  # a patch that knows of the defence
SIDE = 48  # of the patch, texels


class Views(NamedTuple):
    """The vehicle's boxes (B, 4) xyxy, pixels, and images (B, 3, H, W) sRGB by paint."""

    boxes: Tensor
    paints: dict[str, Tensor]

    def part(self, chosen: slice) -> Views:
        return Views(self.boxes[chosen], {name: images[chosen] for name, images in self.paints.items()})


def bench(
    out: Path,
    settings: Settings,
    docs: Path | None,
    run: Path,
    detectors: Sequence[str | Detector],
    patch: float = 0.25,
) -> Results:
    """Every defence on a run's held-out views: normal, in camouflage, and normal with a patch over a share of the box.

    The patch is optimized on every other view against the first detector, and measured on the rest; behind each defence
    a second one goes on from it that knows of the defence.

    Raises:
        RaucaError: the run has no views, the patch is larger than the box, a detector's weights are missing.
    """
    if not 0 < patch <= 1:
        raise RaucaError(f"--patch {patch}: a share of the vehicle's box; give more than 0, 1 at most")
    loaded = [load_detector(d) if isinstance(d, str) else d for d in detectors]
    defences = [make_defence(name) for name in ready_defences()]
    views = read_views(run)
    held = views.part(slice(0, 2 * settings.views, 2))
    results = Results("defences", settings)
    with counted("defences", len(defences) * (settings.steps + 3)) as moved:
        pattern = optimize_patch(loaded[0], views.part(slice(1, None, 2)), patch, settings.steps, moved)
        held.paints["patch"] = paste(held.paints["normal"], held.boxes, pattern, patch)
        for defence in defences:
            for paint, images in held.paints.items():
                _measure(results, defence, paint, images, held.boxes, loaded)
                moved()
            known = pattern
            if defence.name != NO_DEFENCE:
                behind = DefendedDetector(loaded[0], defence)
                known = optimize_patch(behind, views.part(slice(1, None, 2)), patch, settings.steps, moved, pattern)
            images = paste(held.paints["normal"], held.boxes, known, patch)
            _measure(results, defence, INFORMED, images, held.boxes, loaded)
    height, width = held.paints["normal"].shape[2:]
    judged_on = f"{len(held.boxes)} views (patch over {patch:.0%} of the box, optimized on {loaded[0].name})"
    results.figures |= {
        "images": len(held.boxes), "size": [height, width], "white_box": loaded[0].name, "patch_share": patch,
    }  # fmt: skip
    _tables(results, f"{width}x{height}", judged_on)
    pictures = largest_view(held, defences)
    results.picture(lambda path: save_sheet(path, pictures), ".jpg", "defences.jpg")
    results.publish(out, docs, "defences.md", width=150)
    return results


def ready_defences() -> tuple[str, ...]:
    """The names of those that can be used: ``nutnet`` must have learnt from plain frames first."""
    return tuple(name for name in KINDS if name != NutNet.kind or trained())


def read_views(run: Path) -> Views:
    """The held-out frames of a demo's folder that show the vehicle, both paints as Cycles rendered them.

    Raises:
        RaucaError: there are none, some are composed, or an image is missing.
    """
    dataset = Dataset(run / "held-out")
    dataset.require_rendered("defences are judged on")
    frames = [frame for frame in dataset.frames() if frame.box_xyxy is not None]
    if len(frames) < 2:
        raise RaucaError(f"{run}: fewer than two held-out frames show the vehicle; run `rauca demo` first")

    def read(path_of: Callable[[str], Path]) -> Tensor:
        pixels = np.stack([read_frame_image(path_of(frame.id), frame) for frame in frames])
        return torch.from_numpy(pixels).permute(0, 3, 1, 2).float() / 255

    paints = {
        "normal": read(lambda name: dataset.frame_folder(name) / "image.png"),
        "camouflage": read(lambda name: run / "renders" / "ours" / f"{name}.png"),
    }
    return Views(torch.tensor([frame.box_xyxy for frame in frames], dtype=torch.float32), paints)


def patch_area(box: Tensor, share: float) -> tuple[int, int, int]:
    """Left, top and side of the patch in the middle of a box (4,), pixels; it covers ``share`` of the box."""
    width, height = (float(x) for x in box[2:] - box[:2])
    side = max(2, round((share * width * height) ** 0.5))
    left, top = (float(box[i] + box[i + 2] - side) / 2 for i in (0, 1))
    return round(left), round(top), side


def paste(images: Tensor, boxes: Tensor, patch: Tensor, share: float) -> Tensor:
    """Images (B, 3, H, W) with the patch (3, SIDE, SIDE) over ``share`` of each box (B, 4); differentiable."""
    pasted = []
    for image, box in zip(images, boxes, strict=True):
        left, top, side = patch_area(box, share)
        x, y = max(left, 0), max(top, 0)
        resized = functional.interpolate(patch[None], (side, side), mode="bilinear", antialias=True)[0].clamp(0, 1)
        shown = resized[:, y - top : image.shape[1] - top, x - left : image.shape[2] - left]
        margins = (x, image.shape[2] - x - shown.shape[2], y, image.shape[1] - y - shown.shape[1])
        covered = functional.pad(torch.ones_like(shown), margins)
        pasted.append(image * (1 - covered) + functional.pad(shown, margins))
    return torch.stack(pasted)


def optimize_patch(
    detector: Detector, views: Views, share: float, steps: int, moved: Callable[[], None], start: Tensor | None = None,
    batch: int = 4, seed: int = 0,
) -> Tensor:  # fmt: skip
    """A patch (3, SIDE, SIDE) that lowers the detector's car score on the normal vehicle, by Adam; noise to start."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.rand(3, SIDE, SIDE, generator=generator)
    patch = (noise if start is None else start.clone()).requires_grad_()
    optimizer = torch.optim.Adam([patch], lr=0.03)
    for _ in range(steps):
        chosen = torch.randint(len(views.boxes), (batch,), generator=generator)
        images, boxes = views.paints["normal"][chosen], views.boxes[chosen]
        loss = attack_loss(car_score(detector, paste(images, boxes, patch, share), boxes)).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        with torch.no_grad():
            patch.clamp_(0, 1)
        moved()
    return patch.detach()


def _measure(
    results: Results, defence: Defence, paint: str, images: Tensor, boxes: Tensor, detectors: Sequence[Detector]
) -> None:
    """One defence on one paint: CPU ms an image, share of the pixels that it moves, what detectors see."""
    started = time.process_time()
    defended = defence(images)
    cpu_ms = 1000 * (time.process_time() - started) / len(images)
    altered = ((defended - images).abs().amax(1) > ALTERED).float()
    seen = {detector.name: _seen(detector, defended, boxes) for detector in detectors}
    results.add(
        "outcomes", defence=defence.name, fingerprint=defence.fingerprint, paint=paint, cpu_ms=cpu_ms,
        altered=float(altered.mean()), altered_on_vehicle=_mean_in_boxes(altered, boxes),
        ap={name: found[0] for name, found in seen.items()}, score={name: found[1] for name, found in seen.items()},
    )  # fmt: skip


@torch.no_grad()
def _seen(detector: Detector, images: Tensor, boxes: Tensor) -> tuple[float, float]:
    """AP@0.5 of class car and the mean best car score on the vehicle."""
    car, samples, scores = class_index(detector, "car"), [], []
    for batch, truth in zip(images.split(BATCH), boxes.split(BATCH), strict=True):
        scores.append(car_score(detector, batch, truth))
        for box, found in zip(truth, detector.detect(batch, LOW_SCORE, NMS_IOU), strict=True):
            cars = found.labels == car
            parts = (box, found.boxes[cars], found.scores[cars])
            samples.append(Sample(*(part.double().numpy() for part in parts)))
    return average_precision(samples), float(torch.cat(scores).mean())


def _mean_in_boxes(values: Tensor, boxes: Tensor) -> float:
    """Mean over the boxes (B, 4) of the mean of (B, H, W) inside each."""
    corners = boxes.round().int().clamp(min=0).tolist()
    parts = [v[top:bottom, left:right].mean() for v, (left, top, right, bottom) in zip(values, corners, strict=True)]
    return float(np.mean([float(part) for part in parts]))


def _tables(results: Results, size: str, judged_on: str) -> None:
    paints, rows = results.distinct("outcomes", "paint"), []
    for defence in results.distinct("outcomes", "defence"):
        found = {row["paint"]: row for row in results.where("outcomes", defence=defence)}
        white_box = next(iter(found["patch"]["ap"]))
        failed = found[INFORMED]["ap"][white_box] > found["patch"]["ap"][white_box]
        told = {"defence": defence, "verdict": "failed" if failed else ""}
        rows.append(told | {"ms": np.mean([row["cpu_ms"] for row in found.values()]), **found})
    moved = {paint: f"{{{paint}[altered]:.1%}} / {{{paint}[altered_on_vehicle]:.1%}}" for paint in paints}
    title = f"CPU ms per {size} image; pixels moved by > 16 levels: whole image / vehicle's box"
    results.table(title, {"defence": "{defence}", "ms": "{ms:.1f}", **moved}, rows)
    detectors = results.rows["outcomes"][0]["ap"]
    for label, key in (("AP@0.5 of class car", "ap"), ("Mean car score on the vehicle", "score")):
        seen = {f"{paint}, {name}": f"{{{paint}[{key}][{name}]:.3f}}" for paint in paints for name in detectors}
        told = {"informed attack": "{verdict}"} if key == "ap" else {}
        results.table(f"{label}, {judged_on}", {"defence": "{defence}", **seen, **told}, rows)


def largest_view(views: Views, defences: Sequence[Defence]) -> dict[str, dict[str, NDArray[np.float32]]]:
    index = int((views.boxes[:, 2:] - views.boxes[:, :2]).prod(1).argmax())
    return {
        paint: {d.name: d(images[index : index + 1])[0].permute(1, 2, 0).clamp(0, 1).numpy() for d in defences}
        for paint, images in views.paints.items()
    }
