from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.environment.frames import LightFrames
from rauca_core.render import linear_to_srgb
from rauca_core.training.light_batches import augment, collate, crop, draw_albedos, shown


def test_a_frame_holds_the_data_set(dataset):
    frames = LightFrames([dataset.folder])
    frame = frames.get(0)
    assert len(frames) == 8
    assert frame.A.dtype == frame.B.dtype == torch.float16
    again = linear_to_srgb(frame.A.float() * frame.reference[:, None, None] + frame.B.float())
    assert torch.allclose(again, frame.image / 255, atol=0.01)
    assert frame.weather == "clear"
    assert (frame.paint <= frame.vehicle).all()


def test_frames_work_at_a_smaller_size(dataset):
    own, small = LightFrames([dataset.folder]), LightFrames([dataset.folder], size=16)
    frame, shrunk = own.get(0), small.get(0)
    assert shrunk.image.shape == (3, 16, 16)
    mean = torch.nn.functional.avg_pool2d(frame.A.float(), 2)
    assert torch.allclose(shrunk.A.float(), mean, atol=1e-3)
    again = linear_to_srgb(shrunk.A.float() * shrunk.reference[:, None, None] + shrunk.B.float())
    assert torch.allclose(again, shrunk.image / 255, atol=0.005)
    # The vehicle's picture is that of the same camera with larger pixels.
    coverage = torch.nn.functional.avg_pool2d(own.plain(0).coverage[None], 2)[0]
    assert (coverage - small.plain(0).coverage).abs().max() < 0.3
    assert abs(float(coverage.mean() - small.plain(0).coverage.mean())) < 0.01
    assert own.digest != small.digest
    with pytest.raises(RaucaError, match="no multiple of --size 10"):
        LightFrames([dataset.folder], size=10)


def test_memory_is_bounded(dataset):
    frames = LightFrames([dataset.folder])
    frames._budget = 2 * frames.get(0).nbytes
    for i in range(len(frames)):
        frames.get(i)
    assert len(frames._frames) == 2


def test_weathers_and_locations_share_a_cameras_shading(dataset):
    frames = LightFrames([dataset.folder])
    shadings = {id(frames.plain(i)) for i in range(len(frames))}
    assert len(shadings) == 2


@pytest.mark.parametrize("by", ["location", "view"])
def test_the_split_holds_out_whole_places(dataset, by):
    frames = LightFrames([dataset.folder])
    train, test = frames.split(by)
    assert sorted(train + test) == list(range(8))
    names = [{getattr(frames.places[i].frame, by) for i in part} for part in (train, test)]
    assert not names[0] & names[1]
    assert {frames.places[i].frame.weather.name for i in test} == {"clear", "fog"}
    assert frames.split(by) == (train, test)


def test_the_split_stays_where_a_data_set_is_moved(tmp_path, monkeypatch, box_vehicle, dataset_factory):
    folder = dataset_factory(tmp_path / "made", box_vehicle, locations=8, views=1).folder
    made = LightFrames([folder])
    sides = made.split("location", share=0.5)
    monkeypatch.chdir(folder)
    inside = LightFrames([Path()])
    assert (inside.digest, inside.split("location", share=0.5)) == (made.digest, sides)
    moved = LightFrames([folder.rename(tmp_path / "moved")])
    assert (moved.digest, moved.split("location", share=0.5)) == (made.digest, sides)


def test_mistakes_are_named(tmp_path, box_vehicle, dataset, dataset_factory):
    dark = dataset_factory(tmp_path / "dark", box_vehicle, light=False)
    with pytest.raises(RaucaError, match="dark: made without light maps"):
        LightFrames([dark.folder])
    small = dataset_factory(tmp_path / "small", box_vehicle, size=16, locations=1)
    with pytest.raises(RaucaError, match=r"small: frames of 16 pixels, .*; give data sets of one size; `rauca"):
        LightFrames([dataset.folder, small.folder])
    with pytest.raises(RaucaError, match="small: has one location"):
        LightFrames([small.folder]).split("location")
    with pytest.raises(RaucaError, match="none given"):
        LightFrames([])


def test_augmented_frames_are_frames(dataset):
    frames = LightFrames([dataset.folder])
    every, rng = [shown(frames.get(i)) for i in range(8)], np.random.default_rng(0)
    batch, seen = collate(every), collate([augment(one, rng, share=1.0) for one in every])
    assert torch.allclose(linear_to_srgb(seen.A * seen.reference[:, :, None, None] + seen.B), seen.image, atol=0.003)
    assert not torch.allclose(seen.reference, batch.reference)
    assert (seen.A[(seen.paint == 0).expand_as(seen.A)] == 0).all()
    same = collate([augment(one, rng, share=0.0) for one in every])
    assert torch.allclose(same.A.sum(-1), batch.A.sum(-1))  # at most mirrored
    assert torch.equal(same.image.sort(-1).values, batch.image.sort(-1).values)


def test_crops_show_paint_and_make_a_batch(dataset):
    frames = LightFrames([dataset.folder])
    cut = [crop(shown(frames.get(i)), 16, np.random.default_rng(i)) for i in range(8)]
    assert all(c.paint.sum() > 0 for c in cut)
    assert collate(cut).image.shape == (8, 3, 16, 16)
    assert crop(cut[0], 64, np.random.default_rng(0)) is cut[0]


def test_albedos_are_solid_and_per_pixel():
    drawn = draw_albedos(np.random.default_rng(0), 6, 8, 8)
    assert drawn.shape == (6, 3, 8, 8)
    assert ((drawn >= 0) & (drawn <= 1)).all()
    spread = drawn.flatten(2).std(2).amax(1)
    assert (spread[:3] > 0.1).all()
    assert (spread[3:] == 0).all()
