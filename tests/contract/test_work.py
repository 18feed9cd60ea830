"""Work is planned without Blender: shards, chunks, and what the ledgers say."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rauca_core.contract import (
    LedgerEntry,
    RaucaError,
    Ring,
    Shard,
    Weather,
    append_entry,
    cameras_of,
    chunks,
    frame_states,
    in_rendering_order,
    planned_frames,
    read_ledger,
)

from .samples import PLAN as SAMPLE

WEATHERS = tuple(
    Weather(f"sun{altitude}-fog{fog}", altitude, fog_density=fog) for fog in (90, 0, 25) for altitude in (45, -90, -30)
)
PLAN = replace(SAMPLE, weathers=WEATHERS, ring=Ring((0.0, 90.0, 180.0), (10.0,), (6.0, 9.0)), locations=3)


@given(st.integers(1, 40), st.integers(1, 4))
def test_shards_of_any_split_are_the_plan(count, locations):
    plan = replace(PLAN, locations=locations)
    parts = [planned_frames(plan, Shard(i, count)) for i in range(1, count + 1)]
    together = [frame.id for part in parts for frame in part]
    assert sorted(together) == sorted(frame.id for frame in plan.frames())
    cameras = [{frame.camera for frame in part} for part in parts]
    assert sum(map(len, cameras)) == locations * 6  # no camera is in two shards
    assert max(map(len, cameras)) - min(map(len, cameras)) <= 1
    for i, part in enumerate(cameras, 1):
        first, end = cameras_of(plan, Shard(i, count))
        assert {location * 6 + view for location, view in part} == set(range(first, end))


@given(st.integers(1, 200), st.integers(1, 5))
def test_chunks_cover_the_frames_and_hold_to_their_rules(most, every):
    wanted = planned_frames(PLAN)[::every]
    pieces = list(chunks(PLAN, wanted, most))
    assert sorted(f.id for piece in pieces for f in piece) == sorted(f.id for f in wanted)
    for piece in pieces:
        assert len(piece) <= most
        assert len({frame.location for frame in piece}) == 1
        weathers = [frame.weather for frame in piece]
        assert len({w.name for w in weathers}) == 1 + sum(a != b for a, b in pairwise(weathers))
    order = [frame for piece in pieces for frame in piece]
    for camera in {frame.camera for frame in order}:
        seen = [frame.weather for frame in order if frame.camera == camera]
        assert seen == [w for w in in_rendering_order(WEATHERS) if w in seen]
    if most >= len(WEATHERS):
        at = [{frame.camera for frame in piece} for piece in pieces]
        assert sum(map(len, at)) == len({frame.camera for frame in wanted})  # no camera is cut


def test_clear_comes_before_the_fog_composed_from_it():
    order = [weather.name for weather in in_rendering_order(WEATHERS)]
    assert order == [
        "sun45-fog0", "sun45-fog25", "sun45-fog90",
        "sun-90-fog0", "sun-30-fog0", "sun-90-fog25", "sun-30-fog25", "sun-90-fog90", "sun-30-fog90",
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["0/2", "3/2", "1/0", "one/two", "1", "1/2/3", ""])
def test_bad_shards_are_told(text):
    with pytest.raises(RaucaError, match="shard"):
        Shard.parse(text)


def test_the_last_line_of_a_ledger_counts_and_success_outweighs_other_shards(tmp_path):
    append_entry(tmp_path, LedgerEntry("a", "failed", reason="boom"))
    append_entry(tmp_path, LedgerEntry("a", "quarantined", reason="boom"))
    append_entry(tmp_path, LedgerEntry("b", "quarantined", reason="boom"))
    append_entry(tmp_path, LedgerEntry("b", "done", seconds=2.0))
    append_entry(tmp_path, LedgerEntry("c", "occluded", visible=0.1), "1of2")
    append_entry(tmp_path, LedgerEntry("c", "failed", reason="boom"), "2of2")
    with (tmp_path / "ledger.jsonl").open("a") as stream:
        stream.write('{"frame": "d", "sta')
    entries = read_ledger(tmp_path)
    assert {frame: entry.state for frame, entry in entries.items()} == {
        "a": "quarantined",
        "b": "done",
        "c": "occluded",
    }
    assert entries["a"].reason == "boom"
    assert entries["b"].seconds == 2.0
    # Frame b's folder is gone, so it is to be rendered again whatever the ledger says; frame a has one after all.
    (tmp_path / "frames" / "a").mkdir(parents=True)
    (tmp_path / "frames" / "a" / "frame.json").write_text("{}")
    assert frame_states(tmp_path) == {"a": "done", "c": "occluded"}
