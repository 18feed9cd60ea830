from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import (
    METHODS,
    Augmentation,
    DetectorEnsemble,
    OptimizerSettings,
    ensemble,
    make_settings,
    read_history,
    run_optimization,
    settings_of,
)
from rauca_core.attack.naturalness import Naturalness
from rauca_core.attack.optimizer import UNFINISHED
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, RaucaError, Vehicle, load_camouflage
from rauca_core.contract.seeding import named_seed
from rauca_core.runtime.images import read_image
from rauca_core.runtime.tensor_files import CHECKPOINTS, load_checkpoint


def settings(**chosen: Any) -> OptimizerSettings:
    small = {"steps": 8, "batch": 2, "map_size": 64, "samples": 2, "checkpoint_every": 3, "lr": 0.03}
    return make_settings(**(small | chosen))


@pytest.fixture
def run(dataset: Dataset, small_detector: Any, tmp_path: Path) -> Callable[..., Path]:
    """Optimizes into a folder beside the data set, by the settings that are chosen."""

    def start(out: str = "out", on_step: Any = None, **chosen: Any) -> Path:
        return run_optimization(dataset, [small_detector], settings(**chosen), tmp_path / out, on_step)

    return start


def texels(out: Path) -> torch.Tensor:
    return load_checkpoint(out / CHECKPOINTS).tensors["parameter"]


def test_loss_falls_and_the_camouflage_fits(dataset: Dataset, run: Any, tmp_path: Path) -> None:
    seen: list[Any] = []
    path = run(on_step=seen.append, steps=40, roa=False, batch=6, start="plain", name="mine")
    assert [r.step for r in seen] == list(range(1, 41))
    assert seen[-1].attack < 0.9 * seen[0].attack
    assert all(0 < r.stages["detector"] < r.seconds for r in seen)
    assert all(0 < sum(r.stages.values()) <= r.seconds for r in seen)
    camouflage, image = load_camouflage(path)
    assert camouflage.atlas_id == dataset.plan.atlas_id
    assert (camouflage.name, camouflage.method, camouflage.size) == ("mine", "rauca", 64)
    assert (camouflage.made["steps"], camouflage.made["detector"]) == (40, "small")
    assert read_image(image).shape == (64, 64, 3)
    history = read_history(tmp_path / "out")
    assert [h["loss"] for h in history] == [r.loss for r in seen]
    assert seen[0].loss == pytest.approx(seen[0].attack + 0.01 * seen[0].smooth)
    assert list((tmp_path / "out" / "tensorboard").iterdir())


PALETTE, GREY = ("#101010", "#4b5320", "#c8c0a0", "#f0f0f0"), {"reference": "#8c8c8c"}
RESUMED: dict[str, dict[str, Any]] = {
    "falling rate": {"decay": 0.05},
    "dense": {"views": "dense"},
    **{limit: {"limit": limit} for limit in ("project", "clamp", "tanh")},
    **{method: settings_of(method) for method in METHODS},
    "palette": {"natural": Naturalness(palette=PALETTE)},
    "bound": {"natural": Naturalness(**GREY, max_delta_e=15)},
    "all": {"natural": Naturalness(palette=PALETTE, feature_cm=50, **GREY, max_delta_e=50)},
}


@pytest.mark.parametrize("case", RESUMED)
def test_resumed_run_ends_in_the_same_bits(run: Any, tmp_path: Path, case: str) -> None:
    chosen = {"limit": "project"} | RESUMED[case]
    run("whole", **chosen)

    class PowerCutError(Exception):
        pass

    def cut(report: Any) -> None:
        if report.step == 5:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        run("parts", on_step=cut, **chosen)
    steps: list[int] = []
    parts = tmp_path / "parts"
    again = run("parts", on_step=lambda r: steps.append(r.step), **chosen)
    assert steps == [4, 5, 6, 7, 8]  # the checkpoint was made after step 3
    assert torch.equal(texels(tmp_path / "whole"), texels(parts))
    assert again.with_suffix(".png").read_bytes() == (tmp_path / "whole" / "camouflage.png").read_bytes()
    for one, two in zip(read_history(tmp_path / "whole"), read_history(parts), strict=True):
        assert {k: one[k] for k in ("step", "loss", "score")} == {k: two[k] for k in ("step", "loss", "score")}


def test_detectors_in_turn_are_resumed_in_the_same_bits(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    """Each has its own order of frames, and its own that rest."""
    detectors, chosen = [small_detector] * 3, settings(turns=True, rest=1, steps=9)
    whole = Run(dataset, DetectorEnsemble(detectors, "car"), chosen)
    parts = [Run(dataset, DetectorEnsemble(detectors, "car"), chosen) for _ in range(2)]
    assert whole.orders[0].upcoming() != whole.orders[1].upcoming()
    for _ in range(9):
        whole.advance()
    for _ in range(4):
        parts[0].advance()
    parts[1].restore(parts[0].checkpoint())
    for _ in range(5):
        parts[1].advance()
    assert torch.equal(whole.texture.parameter, parts[1].texture.parameter)
    for one, two in zip(whole.orders, parts[1].orders, strict=True):
        assert torch.equal(one.state(), two.state())
    for run in (whole, *parts):
        run.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_stop_signal_leaves_a_checkpoint(run: Any, tmp_path: Path, number: signal.Signals) -> None:
    def stop(report: Any) -> None:
        if report.step == 4:
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    with pytest.raises(RaucaError, match=r"stopped after step 4 of 8.*run the same command again to go on"):
        run(on_step=stop)
    assert signal.getsignal(number) == before
    assert load_checkpoint(tmp_path / "out" / CHECKPOINTS).step == 4
    assert len(read_history(tmp_path / "out")) == 4
    so_far, _ = load_camouflage(tmp_path / "out" / UNFINISHED)
    assert so_far.made["steps"] == 4
    assert not (tmp_path / "out" / "camouflage.json").exists()
    run()
    assert not list((tmp_path / "out").glob("unfinished.*"))
    assert len(read_history(tmp_path / "out")) == 8


def test_runs_outside_the_main_thread(run: Any, tmp_path: Path) -> None:
    thread = threading.Thread(target=run, kwargs={"steps": 1})
    thread.start()
    thread.join()
    assert (tmp_path / "out" / "camouflage.json").is_file()


def test_nan_stops_and_names_the_frame(run: Any, small_detector: Any) -> None:
    broken, calls = small_detector.dense, []

    def dense(images: torch.Tensor) -> Any:
        calls.append(len(images))
        found = broken(images)
        return replace(
            found, objectness=found.objectness * torch.where(images.new_ones(6, 1).cumsum(0) == 5, torch.nan, 1)
        )

    small_detector.dense = dense
    with pytest.raises(RaucaError, match=r"step 1: .* not finite on frame L00-"):
        run(batch=6)
    assert calls == [6]


def test_frames_without_a_box_are_skipped(dataset: Dataset, run: Any) -> None:
    for frame in dataset.frames()[1:]:
        folder = dataset.frame_folder(frame.id)
        fields = json.loads((folder / "frame.json").read_text())
        (folder / "frame.json").write_text(json.dumps({**fields, "box_xyxy": None}))
        (folder / "passes.npz").unlink()  # must not even be opened
    run(steps=2)
    first = dataset.frame_folder(dataset.frames()[0].id) / "frame.json"
    first.write_text(json.dumps({**json.loads(first.read_text()), "box_xyxy": None}))
    with pytest.raises(RaucaError, match="no finished frame shows the vehicle"):
        run("none", steps=2)


def test_images_and_boxes_reach_the_detector_at_its_size(
    run: Any, small_detector: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shapes, boxes = [], []
    score = ensemble.detection_score

    def listen(predictions: Any, truth: torch.Tensor, label: int) -> torch.Tensor:
        boxes.append(truth)
        return score(predictions, truth, label)

    dense = small_detector.dense
    monkeypatch.setattr(small_detector, "dense", lambda x: (shapes.append(tuple(x.shape)), dense(x))[1])
    monkeypatch.setattr(ensemble, "detection_score", listen)
    for number, size in enumerate((None, 128)):
        run(str(number), steps=1, roa=False, detector_size=size)
    assert shapes == [(2, 3, 64, 64), (2, 3, 128, 128)]
    assert torch.equal(boxes[0] * 2, boxes[1])


def test_images_are_moved_before_they_are_reduced(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes, move = [], Augmentation.__call__

    def watched(drawn: Augmentation, images: torch.Tensor, boxes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        sizes.append(tuple(images.shape[2:]))
        return move(drawn, images, boxes)

    monkeypatch.setattr(Augmentation, "__call__", watched)
    run(steps=1, detector_size=32, augmentation="zoomed")
    assert sizes == [(64, 64)]


def test_wrong_conditions_are_refused(run: Any, small_detector: Any, tmp_path: Path, box_vehicle: Vehicle) -> None:
    out = tmp_path / "out"
    run(steps=1)
    for other, named in (({"lr": 0.5, "seed": 9}, "lr, seed"), ({"natural": Naturalness(feature_cm=50)}, "natural")):
        with pytest.raises(RaucaError, match=f"another {named};"):
            run(**other)
    run(steps=2)
    made = (out / "camouflage.json").read_bytes()
    with pytest.raises(RaucaError, match="holds a run of 2 steps already; choose another folder for one of 1, or give"):
        run(steps=1)
    assert (out / "camouflage.json").read_bytes() == made
    with pytest.raises(RaucaError, match="transfer is of rendered frames; drawn views bring their own, drop --light"):
        run("estimated", views="dense", light="transfer")
    with pytest.raises(RaucaError, match="knows no class 'plane'"):
        run("plane", target="plane")
    dark = make_dataset(tmp_path / "dark", box_vehicle, 64, (40.0,), light=False)
    with pytest.raises(RaucaError, match="without light maps"):
        run_optimization(dark, [small_detector], settings(), tmp_path / "nolight")


def test_a_finished_run_whose_history_is_damaged_is_one_line(run: Any, tmp_path: Path) -> None:
    history = tmp_path / "out" / "history.jsonl"
    run(steps=2)
    first, second = history.read_text().splitlines()
    for text, said in (
        ("", "history.jsonl: holds no step of the run; bring it back"),
        (first.replace('"loss"', '"lost"') + f"\n{second}\n", "history.jsonl: line 1 is damaged; remove it"),
        (f'{{"step": 1}}\n{second}\n', "history.jsonl: line 1 is damaged; remove it"),
    ):
        history.write_text(text)
        with pytest.raises(RaucaError, match=said):
            run(steps=2)


def test_settings_name_what_is_wrong() -> None:
    with pytest.raises(RaucaError, match=r"lr: .*-1"):
        make_settings(lr=-1)
    with pytest.raises(RaucaError, match="stepz"):
        make_settings(stepz=3)
    for chosen in ({"beta": math.inf}, {"gamma": math.nan}, {"weights": (1.0, math.nan)}, {"weights": (math.inf,)}):
        with pytest.raises(RaucaError, match=f"^{next(iter(chosen))}.*finite number, not (nan|inf)"):
            make_settings(**chosen)


def test_start_is_named_by_the_seed(run: Any, tmp_path: Path) -> None:
    torch.manual_seed(123)  # global state must not matter
    run(steps=1, lr=1e-9, seed=5)
    found = texels(tmp_path / "out")
    wanted = torch.rand(found.shape, generator=torch.Generator().manual_seed(named_seed(5, "start")))
    assert torch.allclose(found, wanted, atol=1e-6)


ONE_OF_TWO = """
import sys
from pathlib import Path
from rauca_core.attack import make_settings, run_optimization
from rauca_core.contract import Dataset
from rauca_core.runtime.distributed import joined_processes
from benchmarks.stability.detectors import SmallDetector
with joined_processes() as processes:
    for number, chosen in enumerate({settings}):
        out = Path(sys.argv[2]) / str(number)
        data = Dataset(Path(sys.argv[1]))
        run_optimization(data, [SmallDetector()], make_settings(**chosen), out, processes=processes)
"""


KEPT = ("loss", "attack", "smooth", "prior", "score")
EVERY_TERM = {
    "paint": "pattern", "pattern_side": 16, "shift": 0.5, "smooth": "picture", "prior": "background", "gamma": 0.5,
}  # fmt: skip


def test_two_processes_of_torchrun_end_where_one_does(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    runs = [settings(batch=3, beta=3.0, **more) for more in ({}, EVERY_TERM)]  # three frames for two: shares differ
    script = tmp_path / "one_of_two.py"
    script.write_text(ONE_OF_TWO.replace("{settings}", repr([chosen.model_dump(mode="json") for chosen in runs])))
    launcher = ["-m", "torch.distributed.run", "--nproc-per-node", "2", "--master-addr", "127.0.0.1"]
    subprocess.run(
        [sys.executable, *launcher, "--master-port", port, str(script), str(dataset.folder), str(tmp_path / "pair")],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "OMP_NUM_THREADS": "1"},
        timeout=600,
        check=True,
    )
    for number, chosen in enumerate(runs):
        pair, alone = tmp_path / "pair" / str(number), tmp_path / "alone" / str(number)
        run_optimization(dataset, [small_detector], chosen, alone)
        assert (texels(pair) - texels(alone)).abs().max() < 1e-4
        for one, two in zip(read_history(pair), read_history(alone), strict=True):
            assert [one[k] for k in KEPT] == pytest.approx([two[k] for k in KEPT], rel=1e-4, abs=1e-7)


def test_the_learning_rate_falls_along_half_a_cosine_to_its_share(run: Any) -> None:
    falling = settings(steps=10, decay=0.1)
    assert falling.lr_at(0) == pytest.approx(0.03)
    assert falling.lr_at(5) == pytest.approx(0.55 * 0.03)
    assert falling.lr_at(10) == pytest.approx(0.003)
    assert settings().lr_at(7) == 0.03
    run(steps=3, decay=0.0)
    camouflage, _ = load_camouflage(run(steps=6, decay=0.0))  # goes on along the new curve
    assert camouflage.made["steps"] == 6
