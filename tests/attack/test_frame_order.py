from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from rauca_core.attack.frame_order import FrameOrder
from rauca_core.contract import RaucaError

SEEN, HIDDEN = torch.tensor([0.9]), torch.tensor([0.0])


def epochs_of(order: FrameOrder, count: int, epochs: int, quiet: frozenset[int]) -> list[set[int]]:
    """Frames drawn one by one, by the epoch they were drawn in."""
    drawn: list[set[int]] = [set() for _ in range(epochs)]
    while True:
        (frame,) = order.draw(1)
        epoch = (order.place - 1) // count
        if epoch >= epochs:
            return drawn
        drawn[epoch].add(frame)
        order.note([frame], HIDDEN if frame in quiet else SEEN)


def test_every_epoch_shows_every_frame_in_another_order() -> None:
    order = FrameOrder(9, seed=4)
    epochs = [order.draw(9) for _ in range(3)]
    assert all(sorted(epoch) == list(range(9)) for epoch in epochs)
    assert epochs[0] != epochs[1] != epochs[2]


def test_batches_run_over_the_end_of_an_epoch() -> None:
    whole, parts = FrameOrder(5, seed=4), FrameOrder(5, seed=4)
    assert whole.draw(12) == parts.draw(4) + parts.draw(4) + parts.draw(4)


def test_quiet_frames_rest_and_come_back() -> None:
    every, quiet = set(range(6)), frozenset({0, 3})
    found = epochs_of(FrameOrder(6, seed=1, rest=2), 6, 7, quiet)
    assert found == [every, every - quiet, every - quiet, every, every - quiet, every - quiet, every]
    assert epochs_of(FrameOrder(6, seed=1), 6, 3, quiet) == [every] * 3


@given(st.integers(1, 12), st.integers(1, 9), st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_the_stream_never_ends_and_resumes(count: int, batch: int, rest: int, seed: int) -> None:
    order, again = FrameOrder(count, seed, rest), FrameOrder(count, seed, rest)
    for _ in range(5):  # all frames quiet: the hardest case
        order.note(order.draw(batch), torch.zeros(batch))
    again.restore(order.state())
    for _ in range(5):
        one, two = order.draw(batch), again.draw(batch)
        assert one == two
        assert len(one) == batch
        order.note(one, torch.zeros(batch))
        again.note(two, torch.zeros(batch))


def test_state_of_other_frames_is_refused() -> None:
    with pytest.raises(RaucaError, match="holds 3 frames, the data set 4"):
        FrameOrder(4, 0).restore(FrameOrder(3, 0).state())
