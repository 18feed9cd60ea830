"""Evaluation: average precision, results on disk, and the report."""

from .average_precision import Sample, average_precision
from .detection_cache import DetectionSettings
from .evaluate import evaluate
from .images_of import reference_images, rendered_in
from .report import ReportNotes, write_report
from .results import Results, load_results
from .showcase import save_showcase

__all__ = [
    "DetectionSettings",
    "ReportNotes",
    "Results",
    "Sample",
    "average_precision",
    "evaluate",
    "load_results",
    "reference_images",
    "rendered_in",
    "save_showcase",
    "write_report",
]
