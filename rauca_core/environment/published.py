"""The environment feature extractor as published: a U-Net on sRGB values.

It reads the masked reference image and gives six channels through a sigmoid, two maps A and B. The textured vehicle of
the plain neural renderer, x_nr, is then lit as ``clamp(x_nr * A + B, 0, 1)``, in sRGB values (paper, Section III-C).
Both maps end at 1, so no pixel can come out brighter than the plain render plus one; light in the scene can.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.schema import read_json
from ..render import saturate
from ..runtime.carded_weights import load_carded, save_carded

WIDTHS = (64, 128, 256, 512, 1024)


class PublishedEfe(nn.Module):
    """The published U-Net, 34.5 million parameters.

    Args:
        widths: channels per level; the paper's by default, fewer for tests.
    """

    def __init__(self, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        inputs = (3, *widths[:-1])
        self.down = nn.ModuleList(_double(a, b) for a, b in zip(inputs, widths, strict=True))
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.up = nn.ModuleList(_enlarge(a, b) for a, b in pairs)
        self.merge = nn.ModuleList(_double(2 * b, b) for _, b in pairs)
        self.head = nn.Conv2d(widths[0], 6, 1)
        self._stride = 2 ** (len(widths) - 1)

    def forward(self, masked_srgb: Tensor) -> tuple[Tensor, Tensor]:
        """Masked reference image (B, 3, H, W) sRGB -> maps A and B, (B, 3, H, W) each in [0, 1].

        H and W are padded up to a multiple of 16 inside.
        """
        height, width = masked_srgb.shape[-2:]
        below, right = -height % self._stride, -width % self._stride
        x = nn.functional.pad(masked_srgb, (0, right, 0, below))
        skips = []
        for level, block in enumerate(self.down):
            x = block(x if level == 0 else nn.functional.max_pool2d(x, 2))
            skips.append(x)
        for enlarge, merge, skip in zip(self.up, self.merge, skips[-2::-1], strict=True):
            x = merge(torch.cat([skip, enlarge(x)], dim=1))
        maps = torch.sigmoid(self.head(x))[..., :height, :width]
        return maps[:, :3], maps[:, 3:]


def fuse_published(x_nr_srgb: Tensor, A: Tensor, B: Tensor) -> Tensor:
    """``clamp(x_nr * A + B, 0, 1)`` in sRGB values; shapes broadcast."""
    return saturate(x_nr_srgb * A + B)


def _double(inputs: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for a in (inputs, outputs):
        layers += [nn.Conv2d(a, outputs, 3, padding=1), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


def _enlarge(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Upsample(scale_factor=2),
        nn.Conv2d(inputs, outputs, 3, padding=1),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


FORMAT = ("rauca-published-efe-weights", 1)
REMEDY = "train it again with `rauca ablate environment`"


@dataclass(frozen=True)
class PublishedCard:
    """Where weights come from.

    Attributes:
        widths: of the network.
        data: the data set's name, frames trained on, size.
        settings: of the training.
        error: mean absolute error on held-out frames, sRGB values.
    """

    widths: tuple[int, ...]
    data: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    error: float = 0.0


def save_published(path: Path, net: nn.Module, card: PublishedCard) -> None:
    """Write weights and card (.json beside them)."""
    tensors = {name: value.detach().cpu().contiguous() for name, value in net.state_dict().items()}
    save_carded(path, path.with_suffix(".json"), FORMAT, tensors, asdict(card))


def load_published(path: Path) -> PublishedEfe:
    """Read weights; the network is ready to infer on the CPU.

    Raises:
        RaucaError: missing, damaged, or not what their card describes.
    """
    card = path.with_suffix(".json")
    if not path.is_file() or not card.is_file():
        raise RaucaError(f"{path}: no such weights with a card; {REMEDY}")
    fields = read_json(card)
    fields.format(*FORMAT)
    widths = fields.items("widths")
    if not 2 <= len(widths) <= 8 or not all(type(w) is int and 1 <= w <= 4096 for w in widths):
        raise RaucaError(f"{card}: widths must be 2 to 8 whole numbers up to 4096; {REMEDY}")
    return load_carded(lambda: PublishedEfe(tuple(widths)), path, fields.text("sha256"), REMEDY).eval()
