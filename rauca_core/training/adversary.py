"""Camouflages that learn beside the detector: after each of its steps they move to where its loss grows.

What a step's backward pass says of the composed pictures it says of the texels in them, too, so they learn at hardly
any cost (adversarial training for free; Shafahi et al., NeurIPS 2019). A round's attacks meet the detector as it was
when the round began; these meet it as it is. Each lives for some steps and then begins again with a camouflage that is
known, as an attack does that begins well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..contract.seeding import named_rng
from ..render import linear_to_srgb
from ..render.composite import srgb_to_linear
from .samples import draw_color

LIFE = 100  # steps, after which a camouflage begins again
VARIED = 0.5  # share of camouflages that are shown in other colors
FADED = 0.5  # and of these, blended with a plain paint
FAINTEST = 0.6  # largest weight of the plain paint


def vary(texels: Tensor, rng: np.random.Generator) -> Tensor:
    """The same pattern (P, 3) linear, half the time in permuted colors, and of these half faded into a plain paint."""
    if rng.random() >= VARIED:
        return texels
    texels = texels[:, torch.from_numpy(rng.permutation(3))].contiguous()
    if rng.random() < FADED:
        texels = torch.lerp(texels, torch.from_numpy(draw_color(rng)), float(rng.uniform(0, FAINTEST)))
    return texels


class Adversary:
    """Some camouflages for each vehicle, and the optimizer that moves them; all on the CPU, where frames are composed.

    Args:
        known: paintable texels (P, 3) linear of camouflages to begin with, by UV atlas.
        count: of camouflages for each atlas.
        lr: Adam's learning rate, on sRGB values.
        seed: names the random streams.
    """

    def __init__(self, known: Mapping[str, Sequence[Tensor]], count: int, lr: float, seed: int) -> None:
        self._known, self._seed = known, seed
        self._atlases = [atlas for atlas in sorted(known) for _ in range(count)]
        self._maps = [self._beginning(number, 0).requires_grad_() for number in range(len(self._atlases))]
        self._optimizer = torch.optim.Adam(self._maps, lr=lr, maximize=True)

    def draw(self, atlas: str, rng: np.random.Generator) -> Tensor:
        """One of an atlas's camouflages: texels (P, 3) linear, differentiable. Every known atlas has some."""
        numbers = [number for number, own in enumerate(self._atlases) if own == atlas]
        return srgb_to_linear(self._maps[int(rng.choice(numbers))])

    def step(self, done: int) -> None:
        """Move the camouflages by the gradients that the detector's step left; ``done`` steps were taken with it."""
        self._optimizer.step()
        self._optimizer.zero_grad()
        with torch.no_grad():
            for number, texels in enumerate(self._maps):
                texels.clamp_(0, 1)
                if (done + number * LIFE // len(self._maps)) % LIFE == 0:
                    texels.copy_(self._beginning(number, done))
                    self._optimizer.state.pop(texels, None)

    def tensors(self) -> dict[str, Tensor]:
        """All that a step changes, by name."""
        found = {f"{number}.texels": texels.detach() for number, texels in enumerate(self._maps)}
        for number, texels in enumerate(self._maps):
            state = self._optimizer.state.get(texels, {})
            found |= {f"{number}.{name}": torch.as_tensor(value) for name, value in state.items()}
        return found

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Go back to :meth:`tensors`; raises KeyError or RuntimeError where they are of other camouflages."""
        self._optimizer.state.clear()
        states: dict[int, dict[str, Any]] = {}
        for name, value in tensors.items():
            owner, _, entry = name.partition(".")
            states.setdefault(int(owner), {})[entry] = value
        with torch.no_grad():
            for number, texels in enumerate(self._maps):
                state = states[number]
                texels.copy_(state.pop("texels"))
                if state:
                    self._optimizer.state[texels] = state

    def _beginning(self, number: int, done: int) -> Tensor:
        """Texels (P, 3) sRGB: one of the known camouflages, often in other colors."""
        rng = named_rng(self._seed, "adversary", number, done)
        known = self._known[self._atlases[number]]
        return linear_to_srgb(vary(known[int(rng.integers(len(known)))], rng))
