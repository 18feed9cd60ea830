"""Masks blocks that an autoencoder of clean ones cannot say again (idea: NutNet; Lin, Zhao, Chen, He, CCS 2024).

A small autoencoder learns blocks of plain pictures. What it never met, such as a patch, it says badly, and such blocks
are painted black. What differs from the authors' is told in ``docs/defences.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import torch
from pydantic import Field
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn import functional

from ...contract import RaucaError
from ...contract.files import file_digest, write_bytes
from ...contract.seeding import named_seed
from ...detect.frameworks.checkpoint import read_state
from ...detect.weights import weights_folder
from .interface import Defence

SIDE = 8  # pixels, of a block
WIDTH, CODE = 64, 8  # numbers between, of the 192 of a block
STEPS, BLOCKS, LR = 1500, 512, 2e-3
BRIGHTNESS = (0.6, 1.4)  # blocks are shown so much darker or brighter
SOFTNESS = 0.1  # of the smooth choice of blocks, in the logarithm of the error
LEAST = 1e-8  # error; its logarithm stays finite


class NutNet(Defence):
    """Blacks out the blocks of 8 x 8 pixels that are said worse than nearly all plain ones.

    Attributes:
        spared: of the blocks of plain pictures, in percent.
    """

    kind: ClassVar[str] = "nutnet"
    spared: float = Field(99.5, gt=0, lt=100)

    @property
    def fingerprint(self) -> str:
        """Of what was learnt, too; raises :class:`RaucaError` where nothing was."""
        return f"{super().fingerprint} {file_digest(_learnt())}"

    def _defend(self, images: Tensor) -> Tensor:
        """Black where the error is above the limit."""
        with torch.no_grad():
            return images * (1 - _spread(self._excess(images) > 0, images))

    def stand_in(self, images: Tensor) -> Tensor:
        """The same with a smooth choice of blocks: the attack may make blocks that are said well."""
        return images * (1 - _spread((self._excess(images) / SOFTNESS).sigmoid(), images))

    def _excess(self, images: Tensor) -> Tensor:
        """(B, 1, rows, columns): logarithm of each block's error over the limit."""
        path = _learnt()
        network, errors = _read(path, path.stat().st_mtime_ns, images.device, images.dtype)
        limit = errors.quantile(self.spared / 100).clamp(min=LEAST)
        height, width = images.shape[2:]
        whole = functional.pad(images, (0, -width % SIDE, 0, -height % SIDE), mode="replicate")
        found = _errors(network, _blocks(whole))
        return (found.clamp(min=LEAST) / limit).log().view(len(images), 1, -(-height // SIDE), -(-width // SIDE))


def train(pictures: Sequence[Tensor], seed: int = 0) -> Path:
    """Learn the blocks of plain pictures (3, H, W), sRGB in [0, 1], of 16 pixels at least; half a minute of one core.

    Returns:
        The file that :class:`NutNet` reads, in the folder of weights.
    """
    draw = torch.Generator().manual_seed(named_seed(seed, "nutnet"))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(named_seed(seed, "nutnet", "weights"))
        network = autoencoder()
    adam = torch.optim.Adam(network.parameters(), LR)
    schedule = torch.optim.lr_scheduler.LinearLR(adam, 1.0, 0.01, STEPS)
    for _ in range(STEPS):
        number, left, top = (int(torch.randint(most, (1,), generator=draw)) for most in (len(pictures), SIDE, SIDE))
        blocks = _blocks(pictures[number][None, :, top:, left:])[0]
        blocks = blocks[torch.randint(len(blocks), (BLOCKS,), generator=draw)]
        low, high = BRIGHTNESS
        blocks = (blocks * (low + (high - low) * torch.rand(BLOCKS, 1, generator=draw))).clamp(0, 1)
        adam.zero_grad()
        _errors(network, blocks).mean().backward()
        adam.step()
        schedule.step()
    with torch.no_grad():
        errors = torch.cat([_errors(network, _blocks(one[None])[0]) for one in pictures]).sort().values
        few = errors[torch.linspace(0, len(errors) - 1, 1001).long()]
    return _save({**network.state_dict(), "errors": few})


def autoencoder() -> nn.Sequential:
    """(..., 192) -> the same, through 8 numbers."""
    numbers = 3 * SIDE**2
    first, last = (nn.Linear(numbers, WIDTH), nn.ReLU()), (nn.Linear(WIDTH, numbers),)
    return nn.Sequential(*first, nn.Linear(WIDTH, CODE), nn.Linear(CODE, WIDTH), nn.ReLU(), *last)


def trained() -> bool:
    """Whether :class:`NutNet` can be used."""
    return _path().is_file()


def _blocks(images: Tensor) -> Tensor:
    """(B, 3, H, W) -> (B, blocks, 192), row by row."""
    return functional.unfold(images, SIDE, stride=SIDE).transpose(1, 2)


def _errors(network: nn.Module, blocks: Tensor) -> Tensor:
    """Mean squared error of each block (..., 192) -> (...)."""
    errors: Tensor = (network(blocks) - blocks).square().mean(-1)
    return errors


def _spread(chosen: Tensor, like: Tensor) -> Tensor:
    """(B, 1, rows, columns) of blocks -> (B, 1, H, W) of pixels."""
    whole = chosen.to(like).repeat_interleave(SIDE, 2).repeat_interleave(SIDE, 3)
    return whole[:, :, : like.shape[2], : like.shape[3]]


def _path() -> Path:
    return weights_folder() / "nutnet.safetensors"


def _save(tensors: dict[str, Tensor]) -> Path:
    write_bytes(_path(), save(tensors))
    return _path()


@lru_cache(maxsize=2)
def _read(path: Path, changed_ns: int, device: torch.device, dtype: torch.dtype) -> tuple[nn.Module, Tensor]:
    """The autoencoder that was learnt and the errors that it makes of plain blocks; read once, as every batch asks."""
    held = dict(read_state(path))
    errors = held.pop("errors").to(device, dtype)
    with torch.random.fork_rng(devices=[]):  # the numbers that it begins with are drawn, and then replaced
        network = autoencoder()
    network.load_state_dict(held)
    return network.to(device, dtype).requires_grad_(False), errors


def _learnt() -> Path:
    if not trained():
        raise RaucaError("nutnet: has learnt nothing yet; run `rauca weights nutnet DATASET` on plain frames first")
    return _path()
