"""A differentiable renderer of a data set's frames, for an optimization of one's own.

It is made of the pieces that :func:`optimize` itself steps through, so the pictures of a batch are the
optimizer's own to the bit::

    render = Renderer("data/town", texture_size=1024)
    texture = render.new_texture(requires_grad=True)
    images, boxes = render(texture, frames=[0, 7])
    loss(images, boxes).backward()
    render.save(texture, "mine.json")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from ..contract import Camouflage, Dataset, Frame, RaucaError, save_camouflage
from ..contract.seeding import named_seed
from ..render import MipmappedTexture, srgb_to_linear
from ..runtime.devices import find_device
from .frames import FrameStore, boxes_of, render_batch
from .lights import LightName
from .paint import map_png
from .settings import make_settings
from .texture import GREY


class Renderer:
    """Frames of a data set with any texture on the vehicle, differentiable in the texture.

    ``render(texture, frames)`` is what Cycles would show, by the frames' light maps: a pixel's paint has the linear
    albedo x that its camera's taps read from the texture (a fixed sparse operator: visibility, mip level and pixel
    filter), and the pixel is ``linear_to_srgb(A * x + B)``, Eq. 3 of the paper with exact maps in linear light. Pixels
    without paint are the frame's own. Taps are computed at a camera's first use and kept in files.

    Attributes:
        frames: the data set's frames that show the vehicle; positions in this list are the frames' indices.
        texture_size: side of the UV map, texels.
        device: where textures and images lie. Light maps and frames stay in the computer's memory.
    """

    def __init__(
        self,
        dataset: Dataset | Path | str,
        texture_size: int = 1024,
        *,
        samples: int = 12,
        light: LightName = "exact",
        device: torch.device | str = "cpu",
        memory_mb: int = 4096,
        tap_folder: Path | None = None,
    ) -> None:
        """Open a data set.

        Args:
            dataset: made with light maps, or its folder.
            texture_size: side of the UV map, texels.
            samples: a pixel has about ``samples`` x ``samples`` subsamples.
            light: where A and B come from: ``exact`` maps, or ``ours``, estimated from the frames by the extractor.
            device: of the textures; images are computed and returned there.
            memory_mb: frames and taps kept in memory, MiB.
            tap_folder: where taps are kept; beside the frames when None.

        Raises:
            RaucaError: no such data set, none of its frames shows the vehicle, or nothing is paintable at this size.
        """
        dataset = dataset if isinstance(dataset, Dataset) else Dataset(Path(dataset))
        settings = make_settings(
            map_size=texture_size, samples=samples, light=light, memory_mb=memory_mb, tap_folder=tap_folder
        )
        self._store = FrameStore(dataset, settings, device)
        self._places = {frame.id: index for index, frame in enumerate(self._store.frames)}
        self.texture_size, self.device = texture_size, find_device(device)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def frames(self) -> list[Frame]:
        return self._store.frames

    def new_texture(self, seed: int | None = None, *, requires_grad: bool = False) -> Tensor:
        """A UV map (3, H, W) sRGB in [0, 1], row 0 at the top: mid grey, or uniform noise where ``seed`` names it."""
        shape = (3, self.texture_size, self.texture_size)
        if seed is None:
            texture = torch.full(shape, GREY)
        else:
            texture = torch.rand(shape, generator=torch.Generator().manual_seed(named_seed(seed, "texture")))
        return texture.to(self.device).requires_grad_(requires_grad)

    def __call__(self, texture: Tensor, frames: Sequence[int | str | Frame] | None = None) -> tuple[Tensor, Tensor]:
        """Show frames in a texture.

        Args:
            texture: UV map (3, H, W) sRGB on the renderer's device, row 0 at the top. Values beyond [0, 1] are clipped,
                without gradient; texels that no paint face covers count for nothing.
            frames: which, by index, name or the frame itself; all of them at once when None, which takes
                12 bytes * H * W of the images for each.

        Returns:
            images (B, 3, H, W) sRGB in [0, 1], differentiable, and the vehicle's boxes (B, 4) x0 y0 x1 y1, pixels.

        Raises:
            RaucaError: a texture of another shape or device, a frame that the data set does not show, damaged files.
        """
        if texture.shape != (3, self.texture_size, self.texture_size):
            side = self.texture_size
            raise RaucaError(f"texture: the shape is {tuple(texture.shape)}; give (3, {side}, {side})")
        if texture.device.type != self.device.type:
            raise RaucaError(f"texture: lies on {texture.device}, the renderer on {self.device}; move one of them")
        chosen = range(len(self)) if frames is None else [self._index(frame) for frame in frames]
        if not chosen:
            raise RaucaError("frames: none is named; name one, or leave them out for all")
        batch = [self._store.ready(index) for index in chosen]
        pyramid = self._store.pyramid
        images = render_batch(batch, MipmappedTexture(pyramid, srgb_to_linear(pyramid.from_map(texture))))
        return images, boxes_of(batch).to(images.device)

    def save(self, texture: Tensor, path: Path | str, name: str = "own") -> Path:
        """Write a texture as a camouflage, which ``rauca evaluate`` and Blender read: a JSON file, a PNG beside it.

        Args:
            texture: UV map (3, H, W) sRGB, rounded to 8 bits; the gutters are filled from the paint beside them.
            path: of the JSON file.
            name: of the camouflage, in tables.
        """
        vehicle, pyramid, path = self._store.vehicle, self._store.pyramid, Path(path).with_suffix(".json")
        record = Camouflage(name, vehicle.name, vehicle.atlas_id, self.texture_size, "own")
        save_camouflage(path, record, map_png(pyramid, pyramid.from_map(texture.detach().clamp(0, 1))))
        return path

    def _index(self, frame: int | str | Frame) -> int:
        if isinstance(frame, int):
            if not 0 <= frame < len(self):
                raise RaucaError(f"frames: there is no frame {frame}; choose 0 to {len(self) - 1}")
            return frame
        name = frame if isinstance(frame, str) else frame.id
        if name not in self._places:
            raise RaucaError(f"frames: {name} is no finished frame that shows the vehicle; choose one of `.frames`")
        return self._places[name]
