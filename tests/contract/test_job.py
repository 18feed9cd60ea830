"""The file that Blender is started with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipelines.dataset_options import dataset_job, dataset_parser
from rauca_core.contract import (
    ApplyCamouflage,
    ImportVehicle,
    MakeDataset,
    RaucaError,
    RenderCamouflages,
    RenderFrames,
    Shard,
    UnwrapVehicle,
    VehicleSource,
    claim_folder,
    load_job,
    read_plan,
    save_job,
)
from tests.contract.samples import PLAN

CAR = VehicleSource("car.glb", paint_material="Body")
JOBS = [
    MakeDataset(Path("set"), PLAN, CAR, Path("town.blend"), ("a", "b"), Shard(2, 3), 4, 50, True, "auto", ("a note",)),
    MakeDataset(Path("set"), PLAN),
    RenderFrames(Path("plan"), Path("set"), None, 2, "gpu"),
    RenderCamouflages(Path("set"), Path("out"), (Path("a.json"), Path("b.json")), None, 16, False),
    ApplyCamouflage(Path("car.blend"), Path("a.json"), CAR),
    ImportVehicle(Path("vehicle"), CAR),
    UnwrapVehicle(Path("before"), Path("after")),
]


@pytest.mark.parametrize("job", JOBS, ids=lambda job: job.task)
def test_a_job_survives_its_file(job, tmp_path):
    save_job(tmp_path / "job.json", job)
    assert load_job(tmp_path / "job.json") == job


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"task": "dance"}, "task must be one of make_dataset"),
        ({"version": 2}, "update rauca"),
        ({"device": "tpu"}, "device must be one of cpu, gpu, auto"),
        ({"shard": {"index": 4, "count": 2}}, "counted from 1"),
        ({"more": 1}, "unknown field more"),
        ({"workers": "two"}, "workers must be a whole number"),
    ],
)
def test_a_damaged_job_is_refused(changed, told, tmp_path):
    save_job(tmp_path / "job.json", JOBS[0])
    text = json.loads((tmp_path / "job.json").read_text())
    (tmp_path / "job.json").write_text(json.dumps(text | changed))
    with pytest.raises(RaucaError, match=told):
        load_job(tmp_path / "job.json")


def options(*arguments: object) -> MakeDataset:
    return dataset_job(dataset_parser().parse_args(list(map(str, ["--out", "new", *arguments]))))


def test_a_plan_is_taken_from_another_data_set(tmp_path):
    claim_folder(tmp_path, PLAN)
    plan = tmp_path / "dataset.json"
    assert options("--plan", plan).plan == PLAN
    assert options("--plan", plan, "--workers", 2, "--frames", 2).frames is not None
    assert options("--plan", plan).vehicle == VehicleSource()
    (tmp_path / "vehicle").mkdir()
    assert options("--plan", plan).vehicle == VehicleSource(str(tmp_path / "vehicle"))
    with pytest.raises(RaucaError, match=r"--seed: .*dataset.json says it; leave one of the two out"):
        options("--plan", plan, "--seed", 99)


def test_frames_that_are_not_planned_are_refused(tmp_path):
    known = PLAN.frames()[0].id
    (tmp_path / "some.txt").write_text(f"{known}\n")
    claim_folder(tmp_path, PLAN)
    taken = options("--plan", tmp_path / "dataset.json", "--only", tmp_path / "some.txt")
    assert [frame.id for frame in taken.wanted()] == [known]
    (tmp_path / "some.txt").write_text("moon\n")
    with pytest.raises(RaucaError, match=r"some.txt: names moon, which the data set does not plan"):
        options("--plan", tmp_path / "dataset.json", "--only", tmp_path / "some.txt")
    with pytest.raises(RaucaError, match="set: names moon, which"):
        MakeDataset(Path("set"), PLAN, frames=("moon",)).wanted()


def test_another_gpu_goes_on_with_a_data_set_and_a_cpu_does_not(tmp_path):
    from dataclasses import replace

    claim_folder(tmp_path, replace(PLAN, device="OPTIX: One"))
    claim_folder(tmp_path, replace(PLAN, device="CUDA: Other"))
    assert read_plan(tmp_path).device == "OPTIX: One"
    with pytest.raises(RaucaError, match="made with another device"):
        claim_folder(tmp_path, PLAN)
    assert PLAN.to_json()["device"] == "cpu"
