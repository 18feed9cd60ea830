"""The light of a frame: how much of it reaches the paint and comes back (A), and everything else (B).

Linear radiance of a frame is ``A * x + B`` for a paint of albedo x. `exact` reads A and B from a frame that Blender
rendered. An environment feature extractor (the paper's EFE) predicts the same two maps from the reference image alone,
for frames that have no light maps: photographs and other simulators. `extractor` holds ours and the paper's.
"""

from .estimate import estimate, estimate_image
from .exact import Light, load_exact
from .extractor import LightSplitter, PublishedEfe
from .weights import ModelCard, load_extractor, save_extractor

__all__ = [
    "Light",
    "LightSplitter",
    "ModelCard",
    "PublishedEfe",
    "estimate",
    "estimate_image",
    "load_exact",
    "load_extractor",
    "save_extractor",
]
