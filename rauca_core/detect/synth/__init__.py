"""Detectors of our own, for the families that have no weights one could get offline: two-stage and transformer.

Small, trained on this project's synthetic frames, and named as what they are (``frcnn-synth``, ``detr-synth``).
"""

from .card import DetectorCard, SynthDetector, load_weights, read_card, save_weights
from .networks import RECIPES

__all__ = [
    "RECIPES",
    "DetectorCard",
    "SynthDetector",
    "load_weights",
    "read_card",
    "save_weights",
]
