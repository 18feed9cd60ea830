"""Reports: tables, figures and pages of studies."""

from .ablation_page import write_ablation
from .frame import frame_of
from .hardening_page import HardeningNotes, write_hardening
from .showcase import save_showcase
from .study_page import ReportNotes, write_report
from .tradeoff_page import Curve, measure_points, write_curve

__all__ = [
    "Curve",
    "HardeningNotes",
    "ReportNotes",
    "frame_of",
    "measure_points",
    "save_showcase",
    "write_ablation",
    "write_curve",
    "write_hardening",
    "write_report",
]
