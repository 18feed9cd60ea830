"""The light of a frame: how much of it reaches the paint and comes back (A), and everything else (B).

Linear radiance of a frame is ``A * x + B`` for a paint of albedo x. `exact.py` reads A and B from a frame that Blender
rendered. The environment feature extractor (the paper's EFE, a U-Net) will predict the same two maps from the reference
image alone, for frames that have no light maps: photographs and other simulators.
"""

from .exact import Light, load_exact

__all__ = ["Light", "load_exact"]
