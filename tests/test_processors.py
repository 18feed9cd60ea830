"""`make test` runs tests marked ``stored`` on stand-ins for plainer processors: the stand-ins are what they say."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import numba
import numpy as np
import pytest
import torch

from tests import plainer_processor

LEVEL = os.environ.get(plainer_processor.VARIABLE, "")


@pytest.mark.stored
@pytest.mark.skipif(not LEVEL, reason="not on a stand-in for a plainer processor")
def test_libraries_leave_the_extensions_alone():
    forbidden = {"AVX512F", "AVX512_SKX"} | ({"AVX2", "FMA3"} if LEVEL == "sse4" else set())
    features = np.show_config("dicts")["SIMD Extensions"]  # type: ignore[call-overload]
    assert forbidden.isdisjoint(features.get("found", []))
    assert torch.backends.cpu.get_cpu_capability() == {"avx2": "AVX2", "sse4": "DEFAULT"}[LEVEL]
    assert torch.get_num_threads() == 1
    assert plainer_processor.LEVELS[LEVEL]["NUMBA_CPU_NAME"] == numba.config.CPU_NAME


@pytest.mark.skipif(bool(LEVEL), reason="only once")
@pytest.mark.parametrize("level", plainer_processor.LEVELS)
def test_a_command_runs_in_its_environment(level: str):
    shown = "import os; print(os.environ['OMP_NUM_THREADS'], os.environ.get('ATEN_CPU_CAPABILITY'))"
    command = [sys.executable, plainer_processor.__file__, level, sys.executable, "-c", shown]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    same_family = platform.machine() in ("x86_64", "AMD64")
    assert found == ["1", plainer_processor.LEVELS[level]["ATEN_CPU_CAPABILITY"] if same_family else "None"]
