"""Tensorboard's record of a run, whose disk errors are told like those of any other file."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Mapping
from pathlib import Path

from torch import Tensor

from ..contract.files import disk_errors

FLUSH_S = 5  # a tensorboard that watches the run is at most so far behind


class Board:
    """Curves and pictures in a folder. Methods raise :class:`RaucaError` when the disk is full or not writable."""

    def __init__(self, folder: Path, step: int) -> None:
        """Open it; what a killed run recorded from ``step`` on is hidden."""
        from torch.utils.tensorboard import SummaryWriter  # here: of the extra `optimize`, and slow to import

        self._folder = folder
        self._hook = threading.excepthook
        threading.excepthook = self._hush
        with disk_errors(folder):
            self._writer = SummaryWriter(str(folder), purge_step=step, flush_secs=FLUSH_S)

    def scalars(self, values: Mapping[str, float], step: int) -> None:
        """Add a point to each curve."""
        with disk_errors(self._folder):
            for name, value in values.items():
                self._writer.add_scalar(name, value, step)

    def picture(self, name: str, image_srgb: Tensor, step: int) -> None:
        """Show an image (3, H, W)."""
        with disk_errors(self._folder):
            self._writer.add_image(name, image_srgb, step)

    def flush(self) -> None:
        """Bring what was added to the disk."""
        with disk_errors(self._folder):
            self._writer.flush()

    def close(self) -> None:
        """End the record. A disk that is full now was full before, and was told of then."""
        with contextlib.suppress(OSError):
            self._writer.close()
        threading.excepthook = self._hook

    def _hush(self, raised: threading.ExceptHookArgs) -> None:
        """The thread that writes hands its error to the next call of ours, which tells it: once is enough."""
        of_writer = type(raised.thread).__module__.startswith("tensorboard")
        if not (of_writer and issubclass(raised.exc_type, OSError)):
            self._hook(raised)
