"""Threads come back to what they were; large blocks are kept where the C library can."""

from __future__ import annotations

import platform

import pytest
import torch

from rauca_core.runtime.cpu import keep_large_blocks, threads


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
