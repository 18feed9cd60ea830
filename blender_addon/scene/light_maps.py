"""The affine light maps of a frame: any paint's image from a render and the part of a second one that shows paint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract
from . import composed_fog
from .annotate import Annotation
from .render import Crop
from .session import PaintLight, Session, clear

WHITE = 0.8  # an albedo paint can have; A is scaled back to a base color of one
SOLID = 0.999  # coverage from which a pixel is no edge
MARGIN_PX = 16  # around the paint, where its light falls on other things, and for the denoiser

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Coverage = NDArray[np.float32] | Mask
Shot = tuple[int, int, contract.Weather]  # location, view, weather


def light_maps(
    session: Session,
    location: int,
    view: int,
    weather: contract.Weather,
    coverage: Coverage,
    reference_linear: Image,
    annotation: Annotation | None = None,
) -> tuple[Image, Image, Image]:
    """A and B, (H, W, 3) linear each, and the image in the reference paint that they predict.

    Two renders with one seed: black paint gives B, white paint A = (white - black) / albedo. Light without its texture
    is smooth, so the denoiser harms it less than it would a textured car. White is rendered only around the paint, at a
    third of the cost; what its light does further away is 60 dB down (`rauca bench dataset`). Off the paint, what the
    reference paint throws on its surroundings is folded into B and A is zero.

    Args:
        coverage: (H, W) share of each pixel that shows paint, in [0, 1]; True and False will do.
        annotation: what the camera sees, if fog may be composed as the plan says; all of it is rendered without.
    """
    painted, shot = coverage > 0, (location, view, weather)
    light = session.memory.get(*shot)
    if light is None:
        if annotation is not None and composed_fog.is_composed(session.plan.quality, weather):
            light = _compose_light(session, shot, annotation)
        else:
            light = _render_light(session, shot, painted)
        session.memory.keep(*shot, light)
    gain = refine_edges(light.gain, coverage)
    image = gain * reference_linear + light.black
    A = np.where(painted[..., None], gain, 0.0).astype(np.float32)
    B = np.where(painted[..., None], light.black, image).astype(np.float32)
    return A, B, image.astype(np.float32)


def _render_light(session: Session, shot: Shot, painted: Mask) -> PaintLight:
    session.vehicle.paint.set_color((0.0, 0.0, 0.0))
    black = session.render(*shot)
    return PaintLight(_gain(session, shot, Crop.around(painted, MARGIN_PX), black), black)


def _compose_light(session: Session, shot: Shot, annotation: Annotation) -> PaintLight:
    """The vehicle in the real volume, its surroundings composed: see `composed_fog.py`."""
    location, view, weather = shot
    without = (location, view, clear(weather))
    unfogged = session.memory.get(*without)
    if unfogged is None:
        session.set_weather(clear(weather))
        unfogged = _render_light(session, without, annotation.paint > 0)
        session.memory.keep(*without, unfogged)
        session.set_weather(weather)
    session.vehicle.paint.set_color((0.0, 0.0, 0.0))
    coarse = session.render_coarse(*shot)
    black = composed_fog.compose(coarse, unfogged.black, annotation.distance, weather.extinction)
    crop = Crop.around(annotation.vehicle > 0, MARGIN_PX)
    rendered = black.copy()
    if crop is not None:
        rendered[crop.inside] = session.render(*shot, crop)
        black = composed_fog.blend(black, rendered[crop.inside], crop.inside)
    return PaintLight(_gain(session, shot, crop, rendered), black)


def _gain(session: Session, shot: Shot, crop: Crop | None, black: Image) -> Image:
    """What white paint adds to a frame, per albedo; nothing beyond the crop."""
    gain = np.zeros_like(black)
    if crop is not None:
        session.vehicle.paint.set_color((WHITE, WHITE, WHITE))
        white = session.render(*shot, crop)
        gain[crop.inside] = np.maximum((white - black[crop.inside]) / WHITE, 0.0)
    return gain


def refine_edges(gain: Image, coverage: Coverage) -> Image:
    """The gain with the share of paint in its edge pixels taken from ``coverage``.

    A frame's few samples are off by 0.08 in how much of an edge pixel is paint, the annotation's by 0.015. Light on
    the paint itself hardly changes from pixel to pixel: it is read from the neighborhood. By day that takes a fifth of
    the squared error on edges away, at no cost (`docs/environment.md`). Elsewhere the gain stays as it is.
    """
    share = np.asarray(coverage, np.float32)[..., None]
    light = _spread(gain) / np.maximum(_spread(share), 1e-3)
    return np.where((share > 0) & (share < SOLID), share * light, gain).astype(np.float32)


def _spread(image: Image) -> Image:
    """The image (H, W, C), its rows and columns smoothed by 1-2-1; its border repeats."""
    for axis in (0, 1):
        last = image.shape[axis] - 1
        here = np.arange(last + 1)
        before, after = (image.take(np.clip(here + step, 0, last), axis) for step in (-1, 1))
        image = (before + 2 * image + after) / 4
    return image
