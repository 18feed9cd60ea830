"""Reports: tables, figures and pages of studies."""

from .ablation_page import write_ablation
from .hardening_page import HardeningNotes, hardening_table, write_hardening
from .study_page import ReportNotes, Study, evaluate, save_showcase, write_report
from .tradeoff_page import Curve, measure_points, write_curve

__all__ = [
    "Curve",
    "HardeningNotes",
    "ReportNotes",
    "Study",
    "evaluate",
    "hardening_table",
    "measure_points",
    "save_showcase",
    "write_ablation",
    "write_curve",
    "write_hardening",
    "write_report",
]
