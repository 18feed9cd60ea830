"""The hard cases through the real loop: all stays finite, and paint moves where, and only where, it is told to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from benchmarks.stability.detectors import Answering
from benchmarks.stability.drawn import WEATHERS, draw_frame
from benchmarks.stability.optimizer import AZIMUTHS, CASES, SIZE, endure, judge
from rauca_core.attack import METHODS, settings_of
from rauca_core.attack.losses import OBJECTIVES
from rauca_core.contract import Vehicle

BY_NAME = {case.name: case for case in CASES}
ASKED_FOR = (
    "empty mask", "one pixel", "no boxes", "no detection", "certain", "certain, steep", "black night", "fog",
)  # fmt: skip


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Data sets by the name of their case, made by the first test that needs them."""
    return tmp_path_factory.mktemp("cases")


@pytest.mark.parametrize(
    ("steps", "chosen"),
    [(None, {}), (25, {"precision": "bfloat16"}), (8, {"double": True})],
    ids=["whole", "half", "double"],
)
@pytest.mark.parametrize("name", BY_NAME)
def test_hard_case(name: str, steps: int | None, chosen: dict[str, Any], box_vehicle: Vehicle, folders: Path) -> None:
    steps = steps or (500 if name in ASKED_FOR else 60)
    judge(BY_NAME[name], endure(BY_NAME[name], box_vehicle, folders / name, steps, **chosen))


CHOSEN: dict[str, dict[str, Any]] = {
    **{f"{name}, clamp": {"objective": name, "limit": "clamp"} for name in OBJECTIVES},
    **{f"{name}, tanh": {"objective": name, "limit": "tanh"} for name in ("eq6", "attention")},
    **{method: settings_of(method) for method in METHODS},
}


@pytest.mark.parametrize("name", CHOSEN)
def test_every_objective_limit_and_method(box_vehicle: Vehicle, folders: Path, name: str) -> None:
    for case in CASES:
        found = endure(case, box_vehicle, folders / case.name, 4, **CHOSEN[name])
        assert (found.finite, found.in_range) == (True, True), case.name
        assert found.stray == 0 or name in METHODS, case.name


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_every_objective_of_a_certain_answer_in_half_precision(
    box_vehicle: Vehicle, folders: Path, objective: str
) -> None:
    """In bfloat16 a confidence of 1 less a millionth is 1: losses are taken in float32."""
    for name in ("certain", "certain, steep"):
        found = endure(BY_NAME[name], box_vehicle, folders / name, 3, objective=objective, precision="bfloat16")
        assert found.finite, name


def test_smoothness_moves_what_the_attack_cannot_see(box_vehicle: Vehicle, folders: Path) -> None:
    found = endure(BY_NAME["black night"], box_vehicle, folders / "black night", 20, beta=1.0)
    assert found.finite
    assert found.moved == found.learnt == 1.0


def test_cases_are_what_they_are_called(box_vehicle: Vehicle) -> None:
    """The frames and answers themselves: a case that were not hard would prove nothing."""
    frames = {}
    for name, case in BY_NAME.items():
        camera = case.look.camera(AZIMUTHS[0], SIZE)
        frames[name] = draw_frame(box_vehicle, camera, "L00-V000-day", 0, WEATHERS[0], case.look)
    assert frames["empty mask"][1].paint.sum() == 0
    assert frames["one pixel"][1].paint.sum() == 1
    assert 1 <= frames["cut off"][0].box_xyxy[2] < 0.35 * SIZE
    assert frames["black night"][1].image_linear.max() == 0
    assert frames["fog"][1].A.max() == 0 < frames["fog"][1].paint.sum()
    assert frames["negative light"][1].A.min() < 0
    answers = {name: Answering(case.answer).dense(torch.rand(1, 3, SIZE, SIZE)) for name, case in BY_NAME.items()}
    assert answers["no boxes"].boxes.shape[1] == 0
    assert answers["no detection"].objectness.max() == 0
    for name in ("certain", "certain, steep"):
        assert answers[name].objectness.min() == answers[name].classes.min() == 1
        assert tuple(answers[name].boxes[0, 0].tolist()) == frames[name][0].box_xyxy
    assert torch.isinf(answers["endless boxes"].boxes).any()
    assert (answers["inside out"].boxes[..., 2] < answers["inside out"].boxes[..., 0]).all()
