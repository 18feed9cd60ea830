"""When a training has converged: the paper's criterion (its Section IV, on pre-trained extractors).

S_i is the mean absolute error on the test set after epoch i, ``MS_i = gamma * S_{i-1} + (1 - gamma) * S_i`` smooths it,
and epoch i is converged if "the difference between the loss over the previous five epochs and that at epoch i is
within" eta. We read: ``|MS_j - MS_i| <= eta`` for every j of the five epochs before i. Epoch 0 is the start, before any
step; MS_0 = S_0. The first epoch that can pass is thus the fifth, which is the smallest figure the paper reports.
"""

from __future__ import annotations

from collections.abc import Sequence

ETA, WINDOW, GAMMA = 0.003, 5, 0.5


def smoothed(errors: Sequence[float], gamma: float = GAMMA) -> list[float]:
    """MS_i of S_i, i from 0."""
    return [s if i == 0 else gamma * errors[i - 1] + (1 - gamma) * s for i, s in enumerate(errors)]


def converged_epoch(
    errors: Sequence[float], eta: float = ETA, window: int = WINDOW, gamma: float = GAMMA
) -> int | None:
    """The first converged epoch of test errors S_0, S_1, ... (mean absolute, sRGB values in [0, 1]), or None."""
    smooth = smoothed(errors, gamma)
    for i in range(window, len(smooth)):
        if all(abs(before - smooth[i]) <= eta for before in smooth[i - window : i]):
            return i
    return None
