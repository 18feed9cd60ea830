from __future__ import annotations

from typing import Any

import pytest
import torch

from rauca_core.attack import DetectorEnsemble
from rauca_core.contract import RaucaError

BOXES = torch.tensor([[10.0, 12, 50, 44], [20, 20, 60, 60]])


class Other:
    """The same network, blind to the first image's upper half: another detector."""

    name, fingerprint = "other", "4567"

    def __init__(self, detector: Any) -> None:
        self.class_names, self._detector = detector.class_names[::-1], detector

    def dense(self, images: torch.Tensor) -> Any:
        found = self._detector.dense(images.flip(-1))
        found.classes = found.classes.flip(-1)
        return found


def images() -> torch.Tensor:
    return torch.rand(2, 3, 64, 64, generator=torch.Generator().manual_seed(1))


def test_weights_mix_losses_and_gradients(small_detector: Any) -> None:
    both = [small_detector, Other(small_detector)]
    shown = images()
    one, two = (DetectorEnsemble([detector], "car").attack(shown, BOXES) for detector in both)
    mixed = DetectorEnsemble(both, "car", [1, 3]).attack(shown, BOXES)
    assert torch.allclose(mixed.losses, one.losses / 4 + two.losses * 3 / 4)
    assert torch.allclose(mixed.gradient, one.gradient / 4 + two.gradient * 3 / 4, atol=1e-7)
    assert torch.equal(mixed.scores, torch.maximum(one.scores, two.scores))
    assert not torch.allclose(one.gradient, two.gradient)
    assert shown.grad is None


def test_a_weight_of_zero_leaves_a_detector_out(small_detector: Any) -> None:
    alone = DetectorEnsemble([small_detector], "car").attack(images(), BOXES)
    mixed = DetectorEnsemble([small_detector, Other(small_detector)], "car", [2, 0]).attack(images(), BOXES)
    assert torch.equal(alone.losses, mixed.losses)
    assert torch.equal(alone.gradient, mixed.gradient)


def test_detectors_take_turns(small_detector: Any) -> None:
    """Each turn is one detector's own attack; a round's mean is the attack on all at once."""
    both, shown = [small_detector, Other(small_detector)], images()
    turns = [DetectorEnsemble(both, "car").attack(shown, BOXES, turn) for turn in range(4)]
    for turn, detector in zip(turns, both * 2, strict=True):
        alone = DetectorEnsemble([detector], "car").attack(shown, BOXES)
        assert torch.equal(turn.gradient, alone.gradient)
        assert torch.equal(turn.losses, alone.losses)
        assert torch.equal(turn.scores, alone.scores)
    weighted = DetectorEnsemble([small_detector, small_detector, both[1]], "car", [1, 0, 3])
    whole = weighted.attack(shown, BOXES)
    parts = [weighted.attack(shown, BOXES, turn) for turn in range(weighted.turns)]
    assert len(parts) == 2
    assert torch.allclose(sum(p.gradient for p in parts) / 2, whole.gradient, atol=1e-7)


def test_bfloat16_points_the_same_way(small_detector: Any) -> None:
    full = DetectorEnsemble([small_detector], "car").attack(images(), BOXES)
    half = DetectorEnsemble([small_detector], "car", precision="bfloat16").attack(images(), BOXES)
    assert half.losses.dtype == torch.float32
    assert torch.allclose(full.losses, half.losses, rtol=0.05)
    assert torch.cosine_similarity(full.gradient.flatten(), half.gradient.flatten(), dim=0) > 0.95
    assert not torch.equal(full.gradient, half.gradient)


def test_identity_tells_ensembles_apart(small_detector: Any) -> None:
    both = [small_detector, Other(small_detector)]
    assert DetectorEnsemble(both, "car").identity == DetectorEnsemble(both, "car", [5, 5]).identity
    assert DetectorEnsemble(both, "car").identity != DetectorEnsemble(both, "car", [1, 2]).identity
    assert DetectorEnsemble(both, "car").name == "small+other"


def test_bad_ensembles_are_refused(small_detector: Any) -> None:
    with pytest.raises(RaucaError, match="no detector"):
        DetectorEnsemble([], "car")
    with pytest.raises(RaucaError, match="2 for 1"):
        DetectorEnsemble([small_detector], "car", [1, 2])
    with pytest.raises(RaucaError, match="must be 0 or above"):
        DetectorEnsemble([small_detector], "car", [0])
    with pytest.raises(RaucaError, match="class 'bus'"):
        DetectorEnsemble([small_detector], "bus")
