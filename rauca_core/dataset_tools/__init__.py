"""Looking after data sets: check them, look at them, hand them to other tools. NumPy, Pillow and OpenCV only."""

from .check import CheckResult, check_dataset, remove_damaged
from .check_frame import Finding
from .export import FORMATS, export_dataset
from .recoloring import recolor_dataset
from .stored import load_vehicle
from .view import view_dataset

__all__ = [
    "FORMATS",
    "CheckResult",
    "Finding",
    "check_dataset",
    "export_dataset",
    "load_vehicle",
    "recolor_dataset",
    "remove_damaged",
    "view_dataset",
]
