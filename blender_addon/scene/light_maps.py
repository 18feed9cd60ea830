"""The affine light maps of a frame: any paint's image from a render and the part of a second one that shows paint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .render import Crop
from .session import Session

WHITE = 0.8  # an albedo paint can have; A is scaled back to a base colour of one
MARGIN_PX = 16  # around the paint, where its light falls on other things, and for the denoiser


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
    is smooth, so the denoiser harms it less than it would a textured car. White is rendered only around the paint, at a
    third of the cost; what its light does further away is 60 dB down (`rauca bench dataset`). Off the paint, what the
    reference paint throws on its surroundings is folded into B and A is zero.
    """
    gain, black = light_of_paint(session, location, view, weather, painted)
    return fold(gain, black, painted, reference_linear)


def light_of_paint(
    session: Session, location: int, view: int, weather: contract.Weather, painted: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Radiance that a paint of albedo one adds, and radiance with black paint; (H, W, 3) linear each."""
    session.vehicle.paint.set_colour((0.0, 0.0, 0.0))
    black = session.render(location, view, weather)
    gain = np.zeros_like(black)
    crop = Crop.around(painted, MARGIN_PX)
    if crop is not None:
        session.vehicle.paint.set_colour((WHITE, WHITE, WHITE))
        white = session.render(location, view, weather, crop)
        gain[crop.inside] = np.maximum((white - black[crop.inside]) / WHITE, 0.0)
    return gain, black


def fold(
    gain: NDArray[np.float32],
    black: NDArray[np.float32],
    painted: NDArray[np.bool_],
    reference_linear: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A, B and the image in the reference paint, from what :func:`light_of_paint` gives."""
    image = gain * reference_linear + black
    A = np.where(painted[..., None], gain, 0.0).astype(np.float32)
    B = np.where(painted[..., None], black, image).astype(np.float32)
    return A, B, image.astype(np.float32)
