"""Where a chart may lie on the page, against trying every place."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.geometry.pack import Footprint, _collisions, _runs, _stride


@pytest.mark.parametrize(("cells", "height", "width"), [(13, 4, 5), (16, 1, 16), (29, 29, 7), (64, 9, 3), (3, 3, 3)])
def test_collisions_are_those_of_trying_every_place(cells: int, height: int, width: int) -> None:
    rng = np.random.default_rng(cells)
    for share in (0.0, 0.02, 0.2, 1.0):
        taken = rng.random((cells, cells)) < share
        for filled in (0.3, 0.9, 1.0):
            mask = rng.random((height, width)) < filled
            footprint = Footprint(np.zeros((0, 3, 2)), mask, _runs(mask, cells))
            found = _collisions(np.pad(taken, ((0, 0), (0, _stride(cells) - cells))), footprint)
            for row in range(cells - height + 1):
                for column in range(cells - width + 1):
                    there = taken[row : row + height, column : column + width]
                    assert found[row, column] == bool((there & mask).any())
