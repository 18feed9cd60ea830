"""How many of the texels that a ring of cameras sees a renderer's gradient reaches.

The paper claims all of them for its sampler; what is not reached keeps its random start and is printed so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from rauca_core.render import Pyramid, Taps

from .contenders import Contender
from .reference import embree_sees, render_reference
from .scenes import Car, Scene
from .settings import Settings
from .views import ring


def reach(car: Car, contenders: Sequence[Contender], settings: Settings, moved: Callable[[], None]) -> dict[str, float]:
    """Share of the texels that a ring shows, at the largest size, to which each contender's gradient comes.

    More views than elsewhere: texels that a few views show at the rim only are the ones that get lost.
    """
    cameras = ring(car.vehicle, "paper", settings.reach_views, max(settings.sizes))
    seen = np.zeros(car.pyramid.size**2, bool)
    for camera in cameras:
        see = embree_sees(car.caster, camera)
        reference = render_reference(car.vehicle, see, camera, car.maps[:1], settings.reference_samples)
        seen |= reference.touched.ravel()
        moved()
    visible, shares = seen[car.pyramid.texels], {}
    for contender in contenders:
        reached = np.zeros(len(visible), bool)
        for camera in cameras:
            reached |= reached_texels(car.pyramid, [contender.taps(car.vehicle, camera, car.pyramid)])
            moved()
        shares[contender.name] = float((reached & visible).sum() / max(visible.sum(), 1))
    return shares


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
