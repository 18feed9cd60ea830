"""Evaluation: average precision, results on disk, and statistics."""

from .average_precision import Sample, average_precision
from .detection_cache import DetectionSettings
from .evaluate import evaluate
from .images_of import reference_images, rendered_in
from .results import Results, load_results

__all__ = [
    "DetectionSettings",
    "Results",
    "Sample",
    "average_precision",
    "evaluate",
    "load_results",
    "reference_images",
    "rendered_in",
]
