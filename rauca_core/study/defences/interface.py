"""What every defence offers, and what they share: names, fingerprints, checks, 8-bit pixels."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ConfigDict
from torch import Tensor

from ...detect.interface import check_images
from ...runtime.settings import Settings

NO_DEFENCE = "none"


class Defence(Settings):
    """Image pre-processing in front of any detector; parameters are fields, name and fingerprint follow from them.

    Attributes:
        kind: the name without parameters.
        version: raised whenever the output changes for the same parameters.
    """

    model_config = ConfigDict(validate_default=True, arbitrary_types_allowed=True)
    kind: ClassVar[str]
    version: ClassVar[int] = 1

    @classmethod
    def parameters(cls) -> dict[str, int | float]:
        """Default of each field that can be written in a name: the numbers."""
        return {
            name: field.default for name, field in cls.model_fields.items() if isinstance(field.default, int | float)
        }

    @property
    def name(self) -> str:
        """What :func:`make_defence` makes it from: ``jpeg``, ``jpeg:quality=50``; defaults are left out."""
        values = {name: getattr(self, name) for name in self.parameters()}
        changed = [f"{name}={value}" for name, value in values.items() if value != self.parameters()[name]]
        return self.kind + (":" + ",".join(changed) if changed else "")

    @property
    def fingerprint(self) -> str:
        """Changes with every parameter and with the implementation; part of a cache's key."""
        values = [f"{name}={getattr(self, name)!r}" for name in self.parameters()]
        return " ".join([f"{self.kind}/{self.version}", *values])

    def __call__(self, images: Tensor) -> Tensor:
        """Defend images (B, 3, H, W), sRGB in [0, 1] -> the same shape and range; each image by itself.

        Raises:
            RaucaError: another shape or type, NaN, values out of range.
        """
        check_images(f"defence {self.kind}", images, waits=True)
        return self._defend(images)

    def _defend(self, images: Tensor) -> Tensor:
        """The same, of images that were checked."""
        raise NotImplementedError

    def stand_in(self, images: Tensor) -> Tensor:
        """What an attacker who knows of the defence differentiates in its place, (B, 3, H, W) -> the same.

        The images as they are unless a defence says more: straight through (Athalye, Carlini and Wagner, ICML 2018).
        """
        return images


def to_pixels(image: Tensor) -> NDArray[np.uint8]:
    """One image (3, H, W) in [0, 1] -> (H, W, 3) 8-bit RGB, rounded."""
    scaled = (image.detach().clamp(0, 1) * 255).round().to(torch.uint8)
    return np.ascontiguousarray(scaled.permute(1, 2, 0).cpu().numpy())


def from_pixels(pixels: NDArray[np.uint8], like: Tensor) -> Tensor:
    """(H, W, 3) 8-bit RGB -> (3, H, W) in [0, 1], of the type and device of ``like``."""
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).to(like) / 255
