"""Reports: tables, figures and pages of studies."""

from .ablation_page import write_ablation
from .showcase import save_showcase
from .study_page import ReportNotes, write_report

__all__ = ["ReportNotes", "save_showcase", "write_ablation", "write_report"]
