"""Whether detectors agree on composed frames, and that the benchmark sees it where they do not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks import views_agreement
from benchmarks.stability.drawn import painted_box
from benchmarks.views_agreement import bench
from rauca_core.attack import random_camouflage
from rauca_core.contract import Dataset, RaucaError, Vehicle
from rauca_core.detect import Detections
from rauca_core.environment.views import Composed, compose
from tests.environment.room import make_room

NEIGHBORS = 12  # azimuths: a frame left out is composed from some 30 degrees away


class Brightness:
    """Finds one car, where the vehicle of the room is, the surer the brighter the picture is there."""

    name, class_names, fingerprint = "brightness", ("car",), "1"

    def __init__(self, box: Tensor) -> None:
        self.box = box

    def to(self, device: torch.device | str) -> Brightness:
        return self

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        x0, y0, x1, y1 = self.box.int().tolist()
        scores = images[:, :, y0:y1, x0:x1].mean((1, 2, 3))
        return [Detections(self.box[None], score[None], torch.zeros(1, dtype=torch.int64)) for score in scores]


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_room(tmp_path_factory.mktemp("agreement") / "room", painted_box())


def measured(room: Dataset, out: Path) -> dict[str, Any]:
    boxes = torch.tensor([frame.box_xyxy for frame in room.frames() if frame.box_xyxy is not None]).float()
    bench(out, room.folder, detectors=[Brightness(boxes.median(0).values)], frames=8)  # type: ignore[list-item]
    written: dict[str, Any] = json.loads(out.read_text())
    return written


def test_a_detector_sees_the_same_in_composed_frames(room: Dataset, tmp_path: Path) -> None:
    written = measured(room, tmp_path / "agreement.json")
    assert written["settings"]["frames"] == 8
    rows = {row["paint"]: row for row in written["judges"]}
    assert set(rows) == {"own", "random"}
    for row in rows.values():
        assert row["rendered_ap"] > 0.3
        assert row["composed_ap"] == pytest.approx(row["rendered_ap"], abs=0.05)
        assert row["spearman"] > 0.8
    assert len(written["worst"]) == views_agreement.WORST
    assert (tmp_path / "agreement.png").stat().st_size > 1000


def test_it_tells_where_composed_frames_show_something_else(
    room: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)

    def elsewhere(*args: Any, **options: Any) -> Composed:
        made = compose(*args, **options)
        share = np.float32(rng.random())
        A, B = (None if m is None else m * share for m in (made.passes.A, made.passes.B))
        return replace(made, passes=replace(made.passes, A=A, B=B, image_linear=made.passes.image_linear * share))

    monkeypatch.setattr(views_agreement, "compose", elsewhere)
    written = measured(room, tmp_path / "agreement.json")
    assert min(row["spearman"] for row in written["judges"]) < 0.8
    assert not all(target["passed"] for target in written["targets"])


def test_a_camouflage_of_another_vehicle_is_refused(room: Dataset, box_vehicle: Vehicle, tmp_path: Path) -> None:
    other = replace(box_vehicle, name="other", uvs=box_vehicle.uvs * np.float32(0.5))
    random_camouflage(tmp_path / "worn.json", other, 64, cell=8)
    with pytest.raises(RaucaError, match=r"worn.json: is of other, with other UVs"):
        bench(tmp_path / "out.json", room.folder, [tmp_path / "worn.json"], [Brightness(torch.zeros(4))])  # type: ignore[list-item]


def test_a_place_of_one_view_is_refused(tmp_path: Path) -> None:
    lonely = make_room(tmp_path / "room", painted_box(), azimuths=(0.0,))
    frames = lonely.frames()
    for frame in frames[1:]:
        for path in sorted(lonely.frame_folder(frame.id).iterdir()):
            path.unlink()
    with pytest.raises(RaucaError, match="no two frames"):
        measured(Dataset(lonely.folder), tmp_path / "agreement.json")
