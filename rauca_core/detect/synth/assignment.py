"""The cheapest one-to-one assignment: which prediction answers for which object (Kuhn, 1955; shortest paths)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def assign(cost: NDArray[np.floating]) -> NDArray[np.int64]:
    """For each row its own column, so that the sum of costs is the least possible.

    Args:
        cost: (rows, columns) finite, rows <= columns.

    Returns:
        (rows,) columns, all different.
    """
    rows, columns = cost.shape
    if rows > columns:
        raise ValueError(f"{rows} rows cannot have a column each of {columns}")
    # float64: sums and differences of potentials must not lose the small costs beside the large ones.
    padded = np.zeros((rows + 1, columns + 1))
    padded[1:, 1:] = cost
    row_price, column_price = np.zeros(rows + 1), np.zeros(columns + 1)
    owner = np.zeros(columns + 1, np.int64)  # row of each column; row and column 0 stand for "none"
    for row in range(1, rows + 1):
        _augment(padded, row_price, column_price, owner, row)
    found = np.zeros(rows, np.int64)
    taken = np.flatnonzero(owner[1:])
    found[owner[1:][taken] - 1] = taken
    return found


def _augment(
    cost: NDArray[np.float64],
    row_price: NDArray[np.float64],
    column_price: NDArray[np.float64],
    owner: NDArray[np.int64],
    row: int,
) -> None:
    """Give ``row`` a column along the cheapest path that moves others on; Dijkstra on reduced costs."""
    size = len(column_price)
    owner[0], here = row, 0
    distance, before, settled = np.full(size, np.inf), np.zeros(size, np.int64), np.zeros(size, bool)
    while owner[here]:
        settled[here] = True
        mine = owner[here]
        reduced = cost[mine] - row_price[mine] - column_price
        shorter = ~settled & (reduced < distance)
        distance[shorter], before[shorter] = reduced[shorter], here
        nearest = int(np.where(settled, np.inf, distance).argmin())
        step = distance[nearest]
        row_price[owner[settled]] += step
        column_price[settled] -= step
        distance[~settled] -= step
        here = nearest
    while here:
        owner[here] = owner[before[here]]
        here = int(before[here])
