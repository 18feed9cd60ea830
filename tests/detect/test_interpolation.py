"""Weights between a detector as it was and as it learnt: the line, and how far back it is gone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from rauca_core.detect import Detections
from rauca_core.detect.agreement import Agreement
from rauca_core.training.interpolation import (
    MOST_LOOKS,
    SHARES,
    Pictures,
    go_back,
    largest_share,
    mixed,
    standard_error,
)

DOG, CAR = (2.0, 2.0, 12.0, 12.0), (20.0, 40.0, 60.0, 60.0)


class FindsABus(nn.Module):
    """Learns to see a bus where there is none: its score is the one weight; the dog it always finds."""

    def __init__(self, score: float) -> None:
        super().__init__()
        self.score = nn.Parameter(torch.tensor(score))
        self.register_buffer("count", torch.tensor(round(10 * score)))

    def detector(self) -> Any:
        def detect(images: Tensor, score_threshold: float) -> list[Detections]:
            boxes = torch.tensor([DOG, (70.0, 0.0, 90.0, 20.0), CAR])
            scores = torch.tensor([0.9, float(self.score.detach()), 0.1])
            kept = scores >= score_threshold
            return [Detections(boxes[kept], scores[kept], torch.arange(3)[kept])] * len(images)

        return SimpleNamespace(detect=detect, class_names=("dog", "bus", "car"))


def test_the_line_begins_and_ends_at_both_and_counts_are_the_later_ones() -> None:
    before, after = FindsABus(0.0).state_dict(), FindsABus(0.8).state_dict()
    assert mixed(before, after, 0.0)["score"] == 0.0
    assert mixed(before, after, 1.0)["score"] == after["score"]
    half = mixed(before, after, 0.5)
    assert half["score"] == pytest.approx(0.4)
    assert half["count"] == 8


@pytest.mark.parametrize(
    ("score", "wanted", "share"), [(0.4, 0.97, 1.0), (0.8, 0.97, 0.6), (0.8, 0.5, 1.0), (2.0, 0.97, 0.5)]
)
def test_no_more_is_given_back_than_the_other_objects_ask_for(score: float, wanted: float, share: float) -> None:
    """At .5 the bus is said surely, and the detector before said nothing of it; a score of 2 is said at every share."""
    network = FindsABus(score)
    pictures = Pictures(FindsABus(0.0).detector(), [torch.zeros(3, 96, 96)] * 9, [np.array(CAR)] * 8 + [None])
    looks: list[tuple[float, Agreement]] = []
    before = FindsABus(0.0).state_dict()
    kept, agreed = go_back(network, before, lambda n: n.detector(), pictures, wanted, lambda *look: looks.append(look))
    assert kept == share
    assert float(network.score.detach()) == pytest.approx(share * score)
    surely = float(network.score.detach()) >= 0.5
    assert agreed == Agreement(18, 27 if surely else 18, 9, 9)
    assert (kept, agreed) in looks


@pytest.mark.parametrize("enough", [*SHARES, 0.0])
def test_the_largest_share_that_agrees_is_found_in_four_looks(enough: float) -> None:
    looked: list[float] = []

    def agreements(share: float) -> list[Agreement]:
        looked.append(share)
        return [Agreement(10 if share <= enough else 9, 10)] * 2 + [Agreement()]

    share, agreed = largest_share(agreements, 0.97)
    assert share == max(enough, SHARES[-1])
    assert agreed == Agreement(20 if enough else 18, 20)
    assert len(looked) == len(set(looked)) <= 4
    assert MOST_LOOKS == 4


@pytest.mark.parametrize(("pictures", "share"), [(1, 1.0), (10, 1.0), (100, 0.5)])
def test_a_few_pictures_do_not_show_that_anything_must_be_given_back(pictures: int, share: float) -> None:
    """One object in ten is said otherwise at every share: of ten that may be luck, of a hundred it is not."""
    each = [Agreement(int(k % 10 > 0), 1) for k in range(pictures)]
    assert largest_share(lambda _: each, 0.97)[0] == share


def test_the_standard_error_is_that_of_shares_and_of_resampled_places() -> None:
    single = [Agreement(int(k % 4 > 0), 1) for k in range(40)]
    assert standard_error(single) == pytest.approx(np.sqrt(0.75 * 0.25 / 39))
    assert standard_error([*single, *[Agreement()] * 7]) == standard_error(single)  # nothing is there to be seen
    rng = np.random.default_rng(0)
    objects = rng.integers(1, 9, 60)
    agreed = rng.binomial(objects, rng.choice([0.2, 1.0], 60, p=[0.1, 0.9]))
    drawn = rng.integers(0, 60, (4000, 60))
    resampled = agreed[drawn].sum(1) / objects[drawn].sum(1)
    found = standard_error([Agreement(int(a), int(n)) for a, n in zip(agreed, objects, strict=True)])
    assert found == pytest.approx(resampled.std(), rel=0.1)
    assert standard_error(single[:1]) == standard_error([]) == np.inf
