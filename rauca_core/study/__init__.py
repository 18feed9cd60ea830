"""Evaluation: average precision, results on disk, and statistics."""

from .average_precision import Sample, average_precision
from .detection_cache import DetectionSettings
from .results import Results, load_results

__all__ = ["DetectionSettings", "Results", "Sample", "average_precision", "load_results"]
