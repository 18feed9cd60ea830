"""Image pre-processing in front of a detector: what a defender might do to a camouflaged picture."""

from .interface import NO_DEFENCE, Defence
from .lgs import LocalGradientsSmoothing
from .pad import GraphSegments, Pad, Segmenter
from .reference import BitDepth, Jpeg, Median, Nothing
from .registry import defence_names, make_defence

__all__ = [
    "NO_DEFENCE",
    "BitDepth",
    "Defence",
    "GraphSegments",
    "Jpeg",
    "LocalGradientsSmoothing",
    "Median",
    "Nothing",
    "Pad",
    "Segmenter",
    "defence_names",
    "make_defence",
]
