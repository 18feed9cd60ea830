"""How many of the texels that a ring of cameras sees a renderer's gradient reaches.

The paper claims all of them for its sampler; what is not reached keeps its random start and is printed so.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from rauca_core.render import Pyramid, Taps

from .scenes import Scene


def visible_texels(scene: Scene) -> NDArray[np.bool_]:
    """(P,) which of the pyramid's paintable texels any subsample of the reference weighs, over all views."""
    seen = np.zeros(scene.car.pyramid.size**2, bool)
    for reference in scene.references:
        seen |= reference.touched.ravel()
    return seen[scene.car.pyramid.texels]


def reached_texels(pyramid: Pyramid, taps: Sequence[Taps]) -> NDArray[np.bool_]:
    """(P,) which texels receive gradient when every pixel asks for more light, over all views."""
    texels = torch.zeros(len(pyramid.texels), 3, requires_grad=True)
    levels = pyramid(texels)
    # Every weight is positive, so nothing cancels: zero gradient means out of reach.
    asked = sum((view.rows(levels).sum() for view in taps), levels.new_zeros(()))
    (gradient,) = torch.autograd.grad(asked, texels)
    return gradient[:, 0].numpy() > 0
