"""Attack over time: windows of clips, and what each of their frames counts."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from rauca_core.attack import optimize
from rauca_core.attack.history import read_history
from rauca_core.attack.windows import WindowOrder, window_weights, windows_of
from rauca_core.contract import Clips, Dataset, Frame, RaucaError, claim_folder, load_frame
from rauca_core.contract.clips import clip_name
from rauca_core.contract.files import write_json, write_sums

CLIPS = Clips(("passing",), 3, 5.0, 10.0)
TINY = {"method": None, "map_size": 32, "samples": 2, "batch": 4, "steps": 4, "checkpoint_every": 2, "seed": 3}


@pytest.fixture
def clips(dataset: Dataset) -> Dataset:
    """The drawn views, told to follow each other: a clip of three frames by day, and one at dusk."""
    (dataset.folder / "dataset.json").unlink()
    claim_folder(dataset.folder, dataclasses.replace(dataset.plan, clips=CLIPS))
    for frame in dataset.frames():
        name, home = clip_name(CLIPS, 0, frame.view, frame.weather.name), dataset.frame_folder(frame.id)
        write_json(home / "frame.json", dataclasses.replace(frame, clip=name, time_s=frame.view / 10).to_json())
        write_sums(home, [path.name for path in home.iterdir() if path.name != "SHA256SUMS"])
        assert load_frame(home).clip == name
    return Dataset(dataset.folder)


def of_clip(frame: Frame, clip: str, views: range | list[int]) -> list[Frame]:
    return [dataclasses.replace(frame, clip=clip, view=view) for view in views]


def test_windows_are_of_one_clip_and_have_no_hole(clips: Dataset) -> None:
    frame = clips.frames()[0]
    frames = of_clip(frame, "a", [3, 1, 2]) + of_clip(frame, "b", [4, 5, 7, 8]) + of_clip(frame, "", [6])
    assert windows_of(frames, 2) == [(1, 2), (2, 0), (3, 4), (5, 6)]
    assert windows_of(frames, 3) == [(1, 2, 0)]
    with pytest.raises(RaucaError, match="in 4 frames in a row; give a shorter --window"):
        windows_of(frames, 4)
    with pytest.raises(RaucaError, match=r"has no clips.*dataset make --clips"):
        windows_of(of_clip(frame, "", [1, 2, 3]), 2)


def test_every_epoch_shows_every_window_and_a_quiet_one_rests() -> None:
    windows = [(0, 1), (1, 2), (2, 3), (5, 6)]
    order = WindowOrder(windows, seed=4, rest=1)
    drawn = order.draw(8)
    assert sorted(zip(drawn[::2], drawn[1::2], strict=True)) == windows
    seen = torch.tensor([0.9 if frame > 0 else 0.0 for frame in drawn])  # of the window (0, 1) one frame is seen
    order.note(drawn, seen)
    assert sorted(order.draw(8)) == sorted(drawn)
    quiet = [0.0 if drawn[i // 2 * 2] == 5 else 0.9 for i in range(8)]
    order.note(drawn, torch.tensor(quiet))
    rested = order.draw(6)
    assert sorted(zip(rested[::2], rested[1::2], strict=True)) == windows[:3]
    assert set(order.upcoming()) == {0, 1, 2, 3, 5, 6}


def test_the_most_visible_frame_counts_most() -> None:
    losses = torch.tensor([0.1, 2.0, 0.3, 1.0, 1.0, 1.0])
    counts = window_weights(losses, 3, 0.25).reshape(2, 3)
    torch.testing.assert_close(counts.sum(1), torch.tensor([3.0, 3.0]))
    assert counts[0].argmax() == 1
    assert counts[0, 1] > 2.9
    torch.testing.assert_close(counts[1], torch.ones(3))
    torch.testing.assert_close(window_weights(losses, 3, 1e6), torch.ones(6), atol=1e-5, rtol=0)
    # The gradient is the smooth maximum's.
    free = losses.clone().requires_grad_()
    (0.25 * torch.logsumexp(free.reshape(2, 3) / 0.25, 1)).sum().backward()
    torch.testing.assert_close(free.grad, counts.flatten() / 3)


def test_a_run_of_windows_is_told_by_its_seed_and_resumes(clips: Dataset, small_detector, tmp_path: Path) -> None:
    asked = {**TINY, "window": 2}
    whole = optimize(clips, [small_detector], out=tmp_path / "whole", **asked)
    optimize(clips, [small_detector], out=tmp_path / "parts", **{**asked, "steps": 2})
    parts = optimize(clips, [small_detector], out=tmp_path / "parts", **asked)
    np.testing.assert_array_equal(whole.texture, parts.texture)
    losses = [[step["attack"] for step in read_history(tmp_path / name)] for name in ("whole", "parts")]
    assert losses[0] == losses[1]
    stills = optimize(clips, [small_detector], **TINY)
    assert np.abs(stills.texture.astype(int) - whole.texture.astype(int)).max() > 0
    with pytest.raises(RaucaError, match="window"):
        optimize(clips, [small_detector], out=tmp_path / "parts", **{**asked, "window_temperature": 2.0})


def test_mistakes_are_one_line(clips: Dataset, small_detector, tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"window: 3 frames do not fit a batch of 4; .* such as 3"):
        optimize(clips, [small_detector], out=tmp_path, **{**TINY, "window": 3})
    with pytest.raises(RaucaError, match="window: drawn views do not follow each other"):
        optimize(clips, [small_detector], out=tmp_path, **{**TINY, "window": 2, "views": "dense"})


def test_still_views_have_no_windows(dataset: Dataset, small_detector, tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match="the data set has no clips"):
        optimize(dataset, [small_detector], out=tmp_path, **{**TINY, "window": 2})
