"""Frames made ready for the optimizer: everything that does not depend on the texture, computed once."""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Dataset, Frame, RaucaError, load_vehicle
from ..render import MipmappedTexture, Taps, composite, linear_to_srgb, saturate
from ..runtime.images import read_image
from .layout import make_layout
from .lights import light_source
from .settings import OptimizerSettings


@dataclass(frozen=True, eq=False)
class ReadyFrame:
    """One frame, split into what the texture can change and what it cannot.

    Attributes:
        frame: its metadata; ``box_xyxy`` is never None here.
        taps: shared by all frames of the same camera.
        A, B: (R, 3) float32 light maps at the taps' pixels.
        linear: what they add up in, see ``lights.LightSource``.
        background: (H * W, 3) uint8 sRGB, the frame in its reference paint; 8 bits as in the PNG a detector gets.
    """

    frame: Frame
    taps: Taps
    A: Tensor
    B: Tensor
    background: NDArray[np.uint8]
    linear: bool = True

    @property
    def nbytes(self) -> int:
        return self.background.nbytes + self.A.nbytes + self.B.nbytes


class FrameStore:
    """The frames of a data set that show the vehicle, made ready on first use and kept while memory lasts.

    Attributes:
        layout: what is painted, see `layout`.
        pyramid: of the UV map.
        reference_srgb: 8-bit, the paint that the frames were rendered in.
    """

    def __init__(self, dataset: Dataset, settings: OptimizerSettings, device: torch.device | str = "cpu") -> None:
        """``device``: of the extractor, where ``settings.light`` asks for one; frames stay in the computer's memory."""
        self.vehicle = load_vehicle(dataset.vehicle_folder, read_image)
        self.frames = [f for f in dataset.frames() if f.box_xyxy is not None]
        if not self.frames:
            raise RaucaError(f"{dataset.folder}: no finished frame shows the vehicle; make the data set first")
        size = dataset.plan.size
        for frame in self.frames:
            if (frame.camera.width, frame.camera.height) != (size, size):
                raise RaucaError(
                    f"{dataset.frame_folder(frame.id)}/frame.json: the camera is {frame.camera.width}x"
                    f"{frame.camera.height} pixels, the data set's frames are {size}x{size}; render the frame again"
                )
        budget = settings.memory_mb * 2**20 // 2
        self.layout = make_layout(self.vehicle, settings, settings.tap_folder or dataset.folder / "taps", budget)
        self._ready: OrderedDict[int, ReadyFrame] = OrderedDict()
        self._budget = budget
        self.pyramid = self.layout.atlas
        self.reference_srgb = dataset.plan.reference_srgb
        self.light = light_source(settings.light, dataset, self.vehicle, settings.extractor, device)

    def __len__(self) -> int:
        return len(self.frames)

    def ready(self, index: int) -> ReadyFrame:
        """The frame at ``index``, from memory or made ready from disk."""
        found = self._ready.pop(index, None) or self._prepare(self.frames[index])
        self._ready[index] = found
        while sum(f.nbytes for f in self._ready.values()) > self._budget and len(self._ready) > 1:
            self._ready.popitem(last=False)
        return found

    @contextlib.contextmanager
    def warming(self, order: Sequence[int], on_view: Callable[[int, int], None] | None = None) -> Iterator[None]:
        """Build the taps of all cameras in a thread of its own while the caller works; stops when the caller does.

        Args:
            order: frames, the first needed first.
            on_view: called in that thread with cameras done and cameras in all.
        """
        cameras = [self.frames[i].camera_in_vehicle for i in order]
        stop = threading.Event()

        def work() -> None:
            # What stops this thread, a full disk for one, stops `ready` too, which says so.
            with contextlib.suppress(RaucaError):
                self.layout.taps.warm(cameras, on_view, stop)

        thread = threading.Thread(target=work, name="taps", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    def _prepare(self, frame: Frame) -> ReadyFrame:
        taps = self.layout.taps.get(frame.camera_in_vehicle)
        light, image = self.light.of(frame)
        A, B = (torch.from_numpy(m.reshape(-1, 3)[taps.pixels]) for m in (light.A, light.B))
        return ReadyFrame(frame, taps, A, B, image.reshape(-1, 3), self.light.linear)


def shade(batch: Sequence[ReadyFrame], albedo: Tensor) -> Tensor:
    """Linear albedo (R, 3) of the taps' rows, frame after frame, in the frames' light: sRGB images (B, 3, H, W).

    Pixels that no tap reaches keep the frame's reference paint.
    """
    width, height = batch[0].taps.width, batch[0].taps.height
    A, B = torch.cat([f.A for f in batch]).to(albedo), torch.cat([f.B for f in batch]).to(albedo)
    paint = linear_to_srgb(composite(albedo, A, B)) if batch[0].linear else saturate(A * linear_to_srgb(albedo) + B)
    background = torch.from_numpy(np.concatenate([f.background for f in batch])).to(albedo) / 255
    places = np.concatenate([f.taps.pixels.astype(np.int64) + i * width * height for i, f in enumerate(batch)])
    flat = background.index_copy(0, torch.from_numpy(places).to(albedo.device), paint)
    return flat.reshape(len(batch), height, width, 3).permute(0, 3, 1, 2)


def render_batch(batch: Sequence[ReadyFrame], texture: MipmappedTexture) -> Tensor:
    """Frames in a texture -> sRGB images (B, 3, H, W) in [0, 1]."""
    return shade(batch, texture.sample([f.taps.rows for f in batch]))


def boxes_of(batch: Sequence[ReadyFrame]) -> Tensor:
    """Ground-truth boxes (B, 4) xyxy pixels."""
    return torch.tensor([f.frame.box_xyxy for f in batch], dtype=torch.float32)
