"""The same seed, version and device: the same UV map, in processes of their own. What other thread counts change."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.stability.drawn import make_dataset, painted_box
from rauca_core.attack import read_history
from rauca_core.runtime.images import read_image
from tests.published import published_weights

STEPS = 3


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames of a box, before any taps are built."""
    published_weights("yolov3-tiny")
    folder = tmp_path_factory.mktemp("determinism") / "data"
    make_dataset(folder, painted_box(), 64, (40.0, 130.0, 250.0))
    return folder


@pytest.fixture(scope="module")
def first(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return optimized(data, tmp_path_factory.mktemp("first"), threads=1, hash_seed=1)


def optimized(data: Path, where: Path, threads: int, hash_seed: int, seed: int = 5, sampler: str = "area") -> Path:
    """The folder of ``rauca optimize``, run in ``where`` by a process of its own."""
    arguments = ["--out", "out", "--steps", STEPS, "--batch", 2, "--map-size", 64, "--samples", 2, "--seed", seed]
    arguments += ["--threads", threads, "--sampler", sampler, "--method", "rauca-final", "--detector", "yolov3-tiny"]
    command = [sys.executable, "-m", "pipelines", "optimize", data, *arguments]
    environment = {
        **os.environ, "PYTHONHASHSEED": str(hash_seed), "PYTHONPATH": str(Path(__file__).parents[2]),
        "OMP_NUM_THREADS": str(threads),
    }  # fmt: skip
    done = subprocess.run(
        list(map(str, command)), cwd=where, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return where / "out"


def untimed(folder: Path) -> list[dict[str, Any]]:
    """The history without the seconds that steps took."""
    return [{k: v for k, v in row.items() if "seconds" not in k and k != "stages"} for row in read_history(folder)]


def checkpoint(folder: Path) -> tuple[str, bytes]:
    """The latest one's name and tensors."""
    tensors = sorted((folder / "checkpoints").glob("*.safetensors"))[-1]
    return tensors.name, tensors.read_bytes()


def test_two_processes_make_the_same_bytes(data: Path, first: Path, tmp_path: Path) -> None:
    again = optimized(data, tmp_path, threads=1, hash_seed=2)  # the taps come from the cache this time
    assert again.joinpath("camouflage.png").read_bytes() == first.joinpath("camouflage.png").read_bytes()
    assert again.joinpath("camouflage.json").read_bytes() == first.joinpath("camouflage.json").read_bytes()
    assert checkpoint(again) == checkpoint(first)
    assert untimed(again) == untimed(first)
    assert len(untimed(again)) == STEPS


@pytest.mark.parametrize("sampler", ["tensor-traversal", "uv-traversal"])
def test_taps_through_facets_are_those_from_the_cache(data: Path, tmp_path: Path, sampler: str) -> None:
    folders = [tmp_path / name for name in ("built", "cached")]
    for folder in folders:
        folder.mkdir()
    built, cached = (optimized(data, folder, threads=1, hash_seed=1, sampler=sampler) for folder in folders)
    assert checkpoint(cached) == checkpoint(built)
    assert untimed(cached) == untimed(built)


def test_another_seed_makes_another_map(data: Path, first: Path, tmp_path: Path) -> None:
    other = optimized(data, tmp_path, threads=1, hash_seed=1, seed=6)
    maps = [read_image(folder / "camouflage.png") for folder in (first, other)]
    assert (maps[0] != maps[1]).mean() > 0.5


def test_another_number_of_threads_rounds_otherwise_and_no_more(data: Path, first: Path, tmp_path: Path) -> None:
    """Sums of the detector's convolutions are split by threads; nothing else of a step is."""
    other = optimized(data, tmp_path, threads=2, hash_seed=1)
    losses = np.array([[row["loss"] for row in untimed(folder)] for folder in (first, other)])
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)
    maps = [read_image(folder / "camouflage.png").astype(int) for folder in (first, other)]
    assert np.abs(maps[0] - maps[1]).max() <= round(STEPS * 2 * 0.01 * 255)  # Adam's first steps are +-lr each
    assert (maps[0] != maps[1]).mean() < 0.05
