"""`--as published`: losses, augmentation, starts and smoothness against references written out here."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy import ndimage
from torch import Tensor
from torch.nn import functional

from rauca_core.attack import Augmentation, OptimizerSettings, make_settings, read_history, run_optimization
from rauca_core.attack.augmentation import RANGES
from rauca_core.attack.ensemble import DetectorEnsemble
from rauca_core.attack.losses import OBJECTIVES, Predicted, complete_overlap, detection_score
from rauca_core.attack.methods import METHODS, differences, settings_of
from rauca_core.attack.naturalness import Naturalness
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, RaucaError, load_camouflage
from rauca_core.contract.seeding import named_rng
from rauca_core.detect import DensePredictions
from rauca_core.runtime.tensor_files import CHECKPOINTS, load_checkpoint

RIVALS = [name for name, method in METHODS.items() if method.known]
SMALL: dict[str, Any] = {"steps": 3, "map_size": 64, "memory_mb": 256, "checkpoint_every": 3}


def published(method: str, weights: Path, **chosen: Any) -> OptimizerSettings:
    return make_settings(**settings_of(method, "published", extractor=weights, **(SMALL | chosen)))


def drawn_boxes(count: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Boxes near and far, their objectness and classes, and the vehicle's box; two pictures."""
    rng = np.random.default_rng(0)
    corner, sides = rng.uniform(0, 60, (2, count, 2)), rng.uniform(1, 40, (2, count, 2))
    boxes = np.concatenate([corner, corner + sides], 2)
    boxes[:, :4] = [[20, 20, 50, 44], [25, 18, 52, 40], [18, 24, 55, 41], [22, 22, 47, 47]]
    found = (boxes, rng.uniform(0.02, 0.98, (2, count)), rng.uniform(0.02, 0.98, (2, count, 3)))
    truth = torch.tensor([[20.0, 22.0, 51.0, 43.0], [15.0, 20.0, 44.0, 45.0]], dtype=torch.float64)
    return (*(torch.from_numpy(array).requires_grad_() for array in found), truth)  # type: ignore[return-value]


def ciou(box: Tensor, truth: Tensor) -> Tensor:
    """Zheng et al., 2020, of one box with one, xyxy; alpha is held constant."""
    width, height = torch.minimum(box[2:], truth[2:]).sub(torch.maximum(box[:2], truth[:2])).clamp(min=0)
    sizes = [(b[2] - b[0], b[3] - b[1]) for b in (box, truth)]
    iou = width * height / (sizes[0][0] * sizes[0][1] + sizes[1][0] * sizes[1][1] - width * height)
    hull = torch.maximum(box[2:], truth[2:]) - torch.minimum(box[:2], truth[:2])
    centers = [(b[:2] + b[2:]) / 2 for b in (box, truth)]
    v = 4 / math.pi**2 * (torch.atan(sizes[1][0] / sizes[1][1]) - torch.atan(sizes[0][0] / sizes[0][1])) ** 2
    alpha = (v / (v - iou + 1)).detach()
    return iou - ((centers[0] - centers[1]) ** 2).sum() / (hull**2).sum() - alpha * v


def complete_by_hand(boxes: Tensor, objectness: Tensor, classes: Tensor, truth: Tensor) -> Tensor:
    """RAUCA's public loss: -log(1 - max over all boxes, before suppression)."""
    losses = []
    for b in range(len(boxes)):
        scores = [ciou(boxes[b, n], truth[b]) * objectness[b, n] * classes[b, n, 1] for n in range(boxes.shape[1])]
        losses.append(-torch.log(1 - torch.stack(scores).max()))
    return torch.stack(losses)


def fca_by_hand(boxes: Tensor, objectness: Tensor, classes: Tensor, truth: Tensor) -> Tensor:
    """FCA's public loss, layers together: 3 x .05 CIoU, 5.4 x BCE of all cells, 3 x .5 x log-odds of the class."""
    losses = []
    for b in range(len(boxes)):
        overlaps: list[float] = []
        for box in boxes[b].detach():
            sides = (torch.minimum(box[2:], truth[b, 2:]) - torch.maximum(box[:2], truth[b, :2])).clamp(min=0)
            areas = [(one[2] - one[0]) * (one[3] - one[1]) for one in (box, truth[b])]
            overlaps.append(float(sides.prod() / (areas[0] + areas[1] - sides.prod())))
        best = [n for n in np.argsort(overlaps)[::-1][:9].tolist() if overlaps[n] > 0]
        target = torch.zeros(boxes.shape[1], dtype=torch.float64)
        target[best] = 1.0
        overlap = torch.stack([ciou(boxes[b, n], truth[b]) for n in best]).mean()
        odds = torch.logit(classes[b, best, 1]).mean()
        cells = functional.binary_cross_entropy(objectness[b], target)
        losses.append(0.15 * overlap + 5.4 * cells + 1.5 * torch.maximum(odds, torch.zeros(())))
    return torch.stack(losses)


@pytest.mark.parametrize(("method", "reference"), [("rauca-final", complete_by_hand), ("fca", fca_by_hand)])
def test_losses_are_those_of_the_public_code(method: str, reference: Any) -> None:
    parts = drawn_boxes(40)
    settings = make_settings(**settings_of(method, "published"))
    gradients = []
    for loss_of in (reference, None):
        boxes, objectness, classes, truth = (p.detach().clone().requires_grad_() for p in parts)
        truth = truth.detach()
        found = DensePredictions(boxes, objectness, classes)
        given = Predicted(found, truth, 1, detection_score(found, truth, 1))
        loss = OBJECTIVES[settings.objective](given) if loss_of is None else loss_of(boxes, objectness, classes, truth)
        gradients.append((loss.detach(), *torch.autograd.grad(loss.sum(), (boxes, objectness, classes))))
    for wanted, got in zip(*gradients, strict=True):
        assert torch.allclose(got, wanted, rtol=1e-4, atol=1e-6)
    assert gradients[0][0].min() > 0.05


def test_fca_pushes_every_cell_down_but_those_on_the_vehicle() -> None:
    boxes, objectness, classes, truth = drawn_boxes(40)
    found = DensePredictions(boxes, objectness, classes)
    OBJECTIVES["every-cell"](Predicted(found, truth, 1, detection_score(found, truth, 1))).sum().backward()
    slopes = objectness.grad
    assert ((slopes < 0).sum(1) == 9).all()  # Adam goes down: only the nine assigned are pulled up
    assert ((slopes > 0).sum(1) == 31).all()
    assert (slopes[:, :4] < 0).all()


@pytest.mark.parametrize(
    "box", [[5.0, 5, 5, 5], [30.0, 30, 10, 10], [-1e30, -1e30, 1e30, 1e30], [20.0, 22, 51, 43], [1e5, 1e5, 2e5, 2e5]]
)
def test_complete_overlap_is_finite_on_boxes_that_are_none(box: list[float]) -> None:
    boxes = torch.tensor([[box]], requires_grad=True)
    found = complete_overlap(boxes, torch.tensor([[20.0, 22.0, 51.0, 43.0]]))
    found.sum().backward()
    assert -2.01 <= found.item() <= 1
    assert torch.isfinite(boxes.grad).all()


def test_augmentation_is_that_of_the_public_code() -> None:
    """Half are moved, half relit; black around; contrast multiplies; clipped after either; the box stays."""
    batch, side = 64, 24
    drawn = Augmentation.draw(named_rng("as published"), batch, RANGES["published"])
    generator = torch.Generator().manual_seed(1)
    images = torch.rand(batch, 3, side, side, dtype=torch.float64, generator=generator)
    boxes = torch.tensor([[4.0, 5.0, 20.0, 18.0]], dtype=torch.float64).repeat(batch, 1)
    seen, stayed = drawn(images, boxes)
    assert torch.equal(stayed, boxes)
    assert drawn.brightness_first is not None
    for b in range(batch):
        # scipy counts rows first, from the middle of the first pixel.
        matrix = drawn.matrix[b].double().numpy()
        inverse = np.linalg.inv(matrix[:, :2])
        center = np.full(2, (side - 1) / 2)
        offset = center - inverse @ (center + matrix[:, 2] * side)
        moved = [
            ndimage.affine_transform(c, inverse[::-1, ::-1], offset[::-1], order=1, mode="grid-constant", cval=0.0)
            for c in images[b].numpy()
        ]
        value, factor, added = np.stack(moved), float(drawn.contrast[b]), float(drawn.brightness[b])
        if drawn.brightness_first[b]:
            wanted = np.clip(np.clip(value + added, 0, 1) * factor, 0, 1)
        else:
            wanted = np.clip(np.clip(value * factor, 0, 1) + added, 0, 1)
        assert np.abs(seen[b].numpy() - wanted).max() < 1e-5


def test_public_ranges_and_probabilities() -> None:
    drawn = Augmentation.draw(named_rng("public ranges"), 4000, RANGES["published"])
    still = (drawn.matrix == torch.tensor([[1.0, 0, 0], [0, 1, 0]])).all(2).all(1)
    relit = (drawn.contrast != 1) | (drawn.brightness != 0)
    assert drawn.brightness_first is not None
    for happened, share in ((still, 0.5), (relit, 0.5), (drawn.brightness_first, 0.5), (still & relit, 0.25)):
        assert abs(happened.float().mean() - share) < 0.04
    scale = drawn.matrix[~still][:, :, 0].norm(dim=1)
    angle = torch.atan2(drawn.matrix[:, 1, 0], drawn.matrix[:, 0, 0]).rad2deg().abs().max()
    assert 0.7 - 1e-6 <= scale.min() < 0.71
    assert 0.99 < scale.max() <= 1 + 1e-6
    assert 4.9 < angle < 5.001
    assert 0.095 < drawn.matrix[:, :, 2].abs().max() <= 0.1
    assert 0.24 < drawn.brightness.abs().max() <= 0.25
    assert 0.75 <= drawn.contrast.min() < 0.76
    assert 1.49 < drawn.contrast.max() <= 1.5


@pytest.mark.parametrize(
    ("method", "lowest", "mean", "spread"),
    [
        ("fca", 0.5, 0.717, 0.109),  # (tanh u + 1) / 2 of u uniform in [0, 1]: integrals by hand
        ("rauca-base", 0.0025, 0.5, 0.397),  # of u uniform in [-3, 3]
        ("rauca-final", 0.0, 0.5, 0.289),  # uniform
    ],
)
def test_starts(
    dataset: Dataset, small_detector: Any, weights: Path, method: str, lowest: float, mean: float, spread: float
) -> None:
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), published(method, weights))
    colors = run.texture.colors().detach()
    run.close()
    assert colors.min() >= lowest - 1e-4
    assert colors.mean().item() == pytest.approx(mean, abs=0.02)
    assert colors.std().item() == pytest.approx(spread, abs=0.015)


@pytest.mark.parametrize("method", RIVALS)
def test_every_published_form_takes_real_steps(
    dataset: Dataset, small_detector: Any, weights: Path, tmp_path: Path, method: str
) -> None:
    settings = published(method, weights)
    path = run_optimization(dataset, [small_detector], settings, tmp_path / "out")
    record, _ = load_camouflage(path)
    assert (record.name, record.method) == (f"{method}-published", method)
    assert record.made["settings"]["fidelity"] == "published"
    assert len(read_history(tmp_path / "out")) == 3


def test_rauca_final_as_published_end_to_end(
    dataset: Dataset, small_detector: Any, weights: Path, tmp_path: Path
) -> None:
    """On the whole map what Adam takes beyond [0, 1] stays there, and only smoothness brings it back."""
    side = 256  # 2048 as published, which takes two minutes
    settings = published("rauca-final", weights, map_size=side, lr=0.4)
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), settings)
    inside = np.zeros(side * side, bool)
    inside[run.store.pyramid.texels] = True
    values = np.zeros((side * side, 3))
    values[inside] = run.texture.parameter.detach().numpy()
    run.close()
    values, inside = values.reshape(side, side, 3), inside.reshape(side, side)
    down = ((values[1:] - values[:-1]) ** 2).sum(2)[inside[1:] & inside[:-1]].sum()
    across = ((values[:, 1:] - values[:, :-1]) ** 2).sum(2)[inside[:, 1:] & inside[:, :-1]].sum()
    run_optimization(dataset, [small_detector], settings, tmp_path / "out")
    first = read_history(tmp_path / "out")[0]
    assert first["smooth"] == pytest.approx((down + across) / side**2, rel=1e-4)
    assert first["loss"] == pytest.approx(first["attack"] + 0.01 * first["smooth"], rel=1e-5)
    parameter = load_checkpoint(tmp_path / "out" / CHECKPOINTS).tensors["parameter"]
    assert (parameter > 1.01).any()
    assert (parameter < -0.01).any()


def difference_table() -> str:
    """Published against adapted, every rival, as the table that docs/methods.md has to hold."""
    lines = ["| method | published row is | setting | published | adapted |", "|---|---|---|---|---|"]
    for name, method in METHODS.items():
        if not method.known:
            continue
        start = f"| {name} | as its {method.known} says |"
        rows = [f" {field} | {one} | {other} |" for field, (one, other) in differences(name).items()]
        lines += [start + row for row in rows or [" none | – | – |"]]
    return "\n".join(lines)


def test_what_differs_is_read_off_the_settings() -> None:
    assert differences("rauca-final") == {
        "batch": (1, 4), "lr": (0.01, 0.04), "map_size": (2048, 1024), "samples": (2, 12),
        "pixel_filter": ("box", "blackman-harris"),
        "sampler": ("uv-traversal", "area"), "light": ("published", "exact"), "objective": ("complete", "eq6"),
        "smooth": ("unclamped", "map"), "augmentation": ("published", "rauca"),
    }  # fmt: skip
    assert all(make_settings(**settings_of(name, "published")).lr == 0.01 for name in RIVALS)
    assert differences("ours") == {}
    page = (Path(__file__).parents[2] / "docs" / "methods.md").read_text()
    assert difference_table() in page
    for name in RIVALS:
        assert METHODS[name].stand_ins in page


def test_ours_is_the_headlines_with_both_sides_alike_and_detectors_by_turns() -> None:
    ours = make_settings(**settings_of("ours"))
    assert ours.natural == Naturalness(symmetric=True)
    assert ours.turns
    assert (ours.augmentation, ours.rest, ours.objective) == ("zoomed", 3, "log-score")
    assert (ours.lr, ours.decay) == (0.03, 0.03)
    assert (ours.map_size, ours.samples, METHODS["ours"].panel_size) == (512, 4, 320)


def test_runs_begun_before_there_were_two_forms_go_on() -> None:
    assert not {"fidelity", "views"} & set(make_settings(**settings_of("rauca-final")).identity())
    assert make_settings(**settings_of("rauca-final", "published")).identity()["fidelity"] == "published"


def test_what_does_not_fit_is_told_in_one_line(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"--as published: ours was never published; .*choose one of das, fca"):
        settings_of("ours", "published")
    with pytest.raises(RaucaError, match=r"--as: no 'printed'; choose published or adapted"):
        settings_of("fca", "printed")  # type: ignore[arg-type]
    for wrong, told in (
        ({"start": "tanh-wide"}, "--start tanh-wide: is of --limit tanh"),
        ({"smooth": "unclamped"}, "smooth: unclamped needs"),
        ({"light": "published"}, "light: published needs weights"),
    ):
        with pytest.raises(RaucaError, match=told):
            run_optimization(dataset, [small_detector], make_settings(**SMALL, **wrong), tmp_path / "out")
