"""The affine light maps of a frame: any paint's image from two renders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .session import Session

WHITE = 0.8  # an albedo paint can have; A is scaled back to a base colour of one


def light_maps(
    session: Session,
    location: int,
    view: int,
    weather: contract.Weather,
    painted: NDArray[np.bool_],
    reference_linear: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A and B, (H, W, 3) linear each, and the image in the reference paint that they predict.

    Two renders with one seed: black paint gives B, white paint A = (white - black) / albedo. Light without its texture
    is smooth, so the denoiser harms it less than it would a textured car. Away from the paint, what the reference
    paint throws on its surroundings is folded into B and A is zero.
    """
    paint = session.vehicle.paint
    paint.set_colour((WHITE, WHITE, WHITE))
    white = session.render(location, view, weather)
    paint.set_colour((0.0, 0.0, 0.0))
    black = session.render(location, view, weather)
    gain = np.maximum((white - black) / WHITE, 0.0)
    image = gain * reference_linear + black
    A = np.where(painted[..., None], gain, 0.0).astype(np.float32)
    B = np.where(painted[..., None], black, image).astype(np.float32)
    return A, B, image
