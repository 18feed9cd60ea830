"""What the runtime promises: images keep their tones or are refused, threads come back, large blocks are kept."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from rauca_core.contract import RaucaError
from rauca_core.runtime.devices import keep_large_blocks, threads
from rauca_core.runtime.images import read_image

GREYS = np.array([[0, 255, 256, 32768, 65535]])


@pytest.mark.parametrize(("name", "kind"), [("a.png", "<u2"), ("a.tif", "<u2"), ("a.tif", ">u2")])
def test_sixteen_bits_are_scaled_to_eight(tmp_path: Path, name: str, kind: str) -> None:
    Image.fromarray(GREYS.astype(kind)).save(tmp_path / name)
    found = read_image(tmp_path / name)
    assert found.dtype == np.uint8
    assert found.tolist() == [[0, 0, 1, 128, 255]]


@pytest.mark.parametrize("kind", [np.int32, np.float32])
def test_greys_of_no_known_range_are_refused(tmp_path: Path, kind: type) -> None:
    Image.fromarray(GREYS.astype(kind)).save(tmp_path / "a.tif")
    with pytest.raises(RaucaError, match=r"a\.tif: grey in Pillow's mode .*; save it with 8 bits$"):
        read_image(tmp_path / "a.tif")


def test_eight_bits_are_left_alone(tmp_path: Path) -> None:
    for shape in ((1, 5), (1, 5, 3)):
        pixels = np.arange(np.prod(shape), dtype=np.uint8).reshape(shape)
        Image.fromarray(pixels).save(tmp_path / "a.png")
        assert np.array_equal(read_image(tmp_path / "a.png"), pixels)


def test_threads_come_back_even_after_an_error() -> None:
    before = torch.get_num_threads()

    def fail() -> None:
        with threads(before + 1):
            assert torch.get_num_threads() == before + 1
            with threads(None):
                assert torch.get_num_threads() == before + 1
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert torch.get_num_threads() == before


def test_glibc_keeps_large_blocks() -> None:
    if platform.libc_ver()[0] != "glibc":
        pytest.skip("malloc is not glibc's")
    assert keep_large_blocks()
