"""Which frames the next step sees.

Every epoch is a shuffle of all frames. A frame in which the detectors no longer see the vehicle has no gradient left;
it rests for some epochs, so that steps go where there is something to learn, and comes back to be looked at again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import RaucaError
from ..contract.seeding import named_rng

QUIET = 0.02  # max H_d below which a frame rests: the slope of Eq. 6 is then 1.02, but H_d itself hardly has one


class FrameOrder:
    """The stream of frames of a run; a function of the seed and of the scores it was told.

    Attributes:
        place: frames of the shuffles that were passed, drawn or resting.
    """

    def __init__(self, count: int, seed: int, rest: int = 0) -> None:
        """``rest``: epochs that a quiet frame is left out for; 0 shows every frame in every epoch."""
        self._count, self._seed, self._rest = count, seed, rest
        self.place = 0
        self._due = np.zeros(count, np.int64)  # the epoch from which a frame is shown again
        self._shuffle = (-1, np.zeros(0, np.int64))

    def draw(self, batch: int) -> list[int]:
        """The next ``batch`` frames."""
        drawn: list[int] = []
        while len(drawn) < batch:
            epoch, place = divmod(self.place, self._count)
            frame = int(self._epoch(epoch)[place])
            self.place += 1
            if self._due[frame] <= epoch:
                drawn.append(frame)
            elif self._due.min() > epoch:  # all rest: wake those that were to wake first
                self._due -= self._due.min() - epoch
        return drawn

    def note(self, frames: Sequence[int], scores: Tensor) -> None:
        """Learn max H_d, (B,), of frames that were drawn."""
        epoch = max(self.place - 1, 0) // self._count
        for frame, score in zip(frames, scores.tolist(), strict=True):
            self._due[frame] = epoch + 1 + self._rest if score < QUIET and self._rest else 0

    def upcoming(self) -> list[int]:
        """All frames, those first that come next."""
        epoch, place = divmod(self.place, self._count)
        return np.roll(self._epoch(epoch), -place).tolist()

    def state(self) -> Tensor:
        """(1 + count,) int64, for checkpoints."""
        return torch.from_numpy(np.concatenate([[self.place], self._due]))

    def restore(self, state: Tensor) -> None:
        """Go on from :meth:`state`; raises :class:`RaucaError` when it is of other frames."""
        values = state.numpy()
        if values.shape != (1 + self._count,):
            raise RaucaError(f"checkpoint: holds {len(values) - 1} frames, the data set {self._count}; start anew")
        self.place, self._due = int(values[0]), values[1:].copy()

    def _epoch(self, epoch: int) -> NDArray[np.int64]:
        """The order of an epoch: a shuffle of its own, named by seed and epoch."""
        if self._shuffle[0] != epoch:
            self._shuffle = epoch, named_rng(self._seed, "order", epoch).permutation(self._count)
        return self._shuffle[1]
