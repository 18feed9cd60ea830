"""Windows of clips: consecutive frames that a step sees together, and how much each of them counts.

A tracker finds a vehicle again as soon as one frame shows it. So the frame of a window that shows it most counts most:
the loss of a window is a smooth maximum of its frames' losses.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import torch
from torch import Tensor

from ..contract import Frame, RaucaError
from .frame_order import FrameOrder
from .settings import OptimizerSettings


class WindowOrder(FrameOrder):
    """As :class:`FrameOrder`, in which whole windows come and rest: one rests when all of its frames are quiet."""

    def __init__(self, windows: Sequence[Sequence[int]], seed: int, rest: int = 0) -> None:
        """``windows``: indices of frames, equally many in each; no two begin with one frame."""
        super().__init__(len(windows), seed, rest)
        self._windows = windows
        self._length = len(windows[0])
        self._begun_by = {window[0]: number for number, window in enumerate(windows)}

    def draw(self, batch: int) -> list[int]:
        """The frames of the next windows, window after window; ``batch`` frames are a whole number of windows."""
        return [frame for number in super().draw(batch // self._length) for frame in self._windows[number]]

    def note(self, frames: Sequence[int], scores: Tensor) -> None:
        drawn = [self._begun_by[frame] for frame in frames[:: self._length]]
        super().note(drawn, scores.reshape(-1, self._length).amax(1))

    def upcoming(self) -> list[int]:
        return list(dict.fromkeys(frame for number in super().upcoming() for frame in self._windows[number]))


def frame_order(frames: Sequence[Frame], settings: OptimizerSettings, seed: int, count: int) -> FrameOrder:
    """The order of a run's ``count`` frames, or of their windows where ``settings.window`` asks for them.

    Raises:
        RaucaError: see :func:`windows_of`; a batch that is no whole number of windows, drawn views.
    """
    length = settings.window
    if length == 1:
        return FrameOrder(count, seed, settings.rest)
    if settings.batch % length:
        raise RaucaError(
            f"window: {length} frames do not fit a batch of {settings.batch}; give a batch that is a multiple, such as "
            f"{length * max(settings.batch // length, 1)}"
        )
    if settings.views == "dense":
        raise RaucaError("window: drawn views do not follow each other; drop --views dense")
    return WindowOrder(windows_of(frames, length), seed, settings.rest)


def windows_of(frames: Sequence[Frame], length: int) -> list[tuple[int, ...]]:
    """All windows of ``length`` frames of one clip that follow each other without a hole, as indices of ``frames``.

    Raises:
        RaucaError: no clips, or none that is long enough.
    """
    clips: defaultdict[str, list[int]] = defaultdict(list)
    for index, frame in enumerate(frames):
        if frame.clip:
            clips[frame.clip].append(index)
    if not clips:
        raise RaucaError(
            f"window: the data set has no clips, of which {length} frames follow each other; make one with "
            "`rauca dataset make --clips`, or drop --window"
        )
    found = []
    for clip in clips.values():
        clip.sort(key=lambda index: frames[index].view)  # frames that do not show the vehicle are missing
        for window in zip(*(clip[later:] for later in range(length)), strict=False):
            if frames[window[-1]].view - frames[window[0]].view == length - 1:
                found.append(window)
    if not found:
        raise RaucaError(f"window: no clip shows the vehicle in {length} frames in a row; give a shorter --window")
    return found


def window_weights(losses: Tensor, length: int, temperature: float) -> Tensor:
    """How much each frame counts, with a mean of 1: the softmax of its window's losses.

    They are constants of the gradient, which so is that of ``temperature * log(sum(exp(loss / temperature)))``, the
    smooth maximum: no frame is made more visible to take weight from another.

    Args:
        losses: (B,), window after window.
        temperature: in units of the loss; toward 0 only the most visible frame counts, at a high one all count alike.
    """
    return length * torch.softmax(losses.detach().reshape(-1, length) / temperature, 1).flatten()
