"""Camouflage that people could paint and would pass by: few colors, patches of a size, close to a reference.

The paper names naturalness as its first limitation. Each constraint is one module and works with every other; the free
parameters stay colors in [0, 1], so that the optimizer, its limits and its checkpoints know nothing of it.
"""

from .choice import Naturalness

__all__ = ["Naturalness"]
