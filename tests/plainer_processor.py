"""Runs a command as if on a plainer processor: ``python tests/plainer_processor.py LEVEL COMMAND...``.

Libraries choose their code by what the processor can do, and what they choose rounds differently. Each of them can be
told to leave extensions alone, by a variable of the environment that it reads when it is loaded.

Levels: ``avx2``, a processor without AVX-512; ``sse4``, one without AVX2 and FMA either. One thread.
"""

from __future__ import annotations

import os
import platform
import sys

VARIABLE = "RAUCA_PLAINER_PROCESSOR"
_AVX512 = ("AVX512F", "AVX512CD", "AVX512_SKX", "AVX512_CLX", "AVX512_CNL", "AVX512_ICL")
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
LEVELS = {
    "avx2": {
        "NPY_DISABLE_CPU_FEATURES": " ".join(_AVX512),
        "ATEN_CPU_CAPABILITY": "avx2",  # torch's own kernels
        "ONEDNN_MAX_CPU_ISA": "AVX2",  # torch's convolutions
        "OPENBLAS_CORETYPE": "Haswell",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "+avx2,+fma",
        "OPENCV_CPU_DISABLE": "AVX512-SKX",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F",  # the mathematical functions of C
    },
    "sse4": {
        "NPY_DISABLE_CPU_FEATURES": " ".join(("F16C", "FMA3", "AVX2", *_AVX512)),
        "ATEN_CPU_CAPABILITY": "default",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "x86-64",
        "NUMBA_CPU_FEATURES": "",
        "OPENCV_CPU_DISABLE": "AVX2,FMA3,AVX512-SKX",
        "CYCLES_CPU_NO_AVX2": "1",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4",
    },
}


def main(arguments: list[str]) -> None:
    """Replace this process by the command. On another family of processors it runs as it is, on one thread."""
    level, *command = arguments
    chosen = LEVELS[level] if platform.machine() in ("x86_64", "AMD64") else {}
    environment = {**os.environ, **_ONE_THREAD, **chosen, VARIABLE: level if chosen else ""}
    os.execvpe(command[0], command, environment)


if __name__ == "__main__":
    main(sys.argv[1:])
