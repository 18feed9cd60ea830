"""Image pre-processing in front of a detector: what a defender might do to a camouflaged picture."""

from .interface import Defence
from .jpeg import Jpeg
from .lgs import LocalGradientsSmoothing
from .pad import Pad
from .reference import BitDepth, Median, Nothing
from .registry import defence_names, make_defence
from .segments import GraphSegments, Segmenter

__all__ = [
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
