"""Randomness with a name: every stream is a function of what it is for, never of call order."""

from __future__ import annotations

import hashlib

import numpy as np


def named_seed(*names: object) -> int:
    """A 63-bit seed that depends only on the names, e.g. ``named_seed(seed, "view", location, view)``."""
    digest = hashlib.sha256("\x1f".join(str(name) for name in names).encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


def named_rng(*names: object) -> np.random.Generator:
    """A NumPy generator seeded by :func:`named_seed`."""
    return np.random.Generator(np.random.PCG64(named_seed(*names)))
