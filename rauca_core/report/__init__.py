"""Reports: tables, figures and pages of studies."""

from .ablation_page import write_ablation
from .hardening_page import write_hardening
from .study_page import ReportNotes, Study, evaluate, save_showcase, write_report
from .tradeoff_page import write_curve

__all__ = [
    "ReportNotes",
    "Study",
    "evaluate",
    "save_showcase",
    "write_ablation",
    "write_curve",
    "write_hardening",
    "write_report",
]
