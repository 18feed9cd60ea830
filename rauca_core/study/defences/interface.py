"""What every defence offers, and what they share: names, fingerprints, checks, 8-bit pixels."""

from __future__ import annotations

from dataclasses import Field, dataclass, fields
from typing import Any, ClassVar, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...contract import RaucaError
from ...detect.interface import check_images


class Defence(Protocol):
    """Image pre-processing in front of any detector.

    Attributes:
        name: what :func:`make_defence` makes this defence from: ``jpeg``, ``jpeg:quality=50``.
        fingerprint: changes with every parameter and with the implementation; part of a cache's key.
    """

    @property
    def name(self) -> str: ...

    @property
    def fingerprint(self) -> str: ...

    def __call__(self, images: Tensor) -> Tensor:
        """Defend images (B, 3, H, W), sRGB in [0, 1] -> the same shape and range; each image by itself.

        Raises:
            RaucaError: another shape or type, NaN, values out of range.
        """
        ...


@dataclass(frozen=True)
class Configured:
    """A defence whose parameters are its dataclass fields; name and fingerprint follow from them.

    Attributes:
        kind: the name without parameters.
        version: raised whenever the output changes for the same parameters.
    """

    kind: ClassVar[str]
    version: ClassVar[int]

    @classmethod
    def parameters(cls) -> tuple[Field[Any], ...]:
        """The fields that can be written in a name: the numbers."""
        return tuple(field for field in fields(cls) if isinstance(field.default, int | float))

    @property
    def name(self) -> str:
        """The kind, and the parameters that are not at their defaults."""
        changed = [
            f"{field.name}={getattr(self, field.name)}"
            for field in self.parameters()
            if getattr(self, field.name) != field.default
        ]
        return self.kind + (":" + ",".join(changed) if changed else "")

    def check(self, images: Tensor) -> None:
        """Raise :class:`RaucaError` unless the images are (B, 3, H, W) sRGB in [0, 1]."""
        check_images(f"defence {self.kind}", images, waits=True)

    @property
    def fingerprint(self) -> str:
        """Kind, version and every parameter."""
        values = [f"{field.name}={getattr(self, field.name)!r}" for field in self.parameters()]
        return " ".join([f"{self.kind}/{self.version}", *values])


def require(holds: bool, kind: str, wrong: str, remedy: str) -> None:
    """Refuse a parameter in one line; raises :class:`RaucaError` unless it ``holds``."""
    if not holds:
        raise RaucaError(f"defence {kind}: {wrong}; {remedy}")


def to_pixels(image: Tensor) -> NDArray[np.uint8]:
    """One image (3, H, W) in [0, 1] -> (H, W, 3) 8-bit RGB, rounded."""
    scaled = (image.detach().clamp(0, 1) * 255).round().to(torch.uint8)
    return np.ascontiguousarray(scaled.permute(1, 2, 0).cpu().numpy())


def from_pixels(pixels: NDArray[np.uint8], like: Tensor) -> Tensor:
    """(H, W, 3) 8-bit RGB -> (3, H, W) in [0, 1], of the type and device of ``like``."""
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).to(like) / 255
