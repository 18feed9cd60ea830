"""Reports: tables, figures and pages of studies."""

from .ablation_page import write_ablation
from .assessment_page import write_assessment
from .clips_page import write_clips
from .compared_page import write_compared
from .comparison_page import write_comparison
from .hardening_page import write_hardening
from .robustness import Robustness, assess
from .study_page import ReportNotes, Study, evaluate, save_showcase, write_report
from .tradeoff_page import write_curve

__all__ = [
    "ReportNotes",
    "Robustness",
    "Study",
    "assess",
    "evaluate",
    "save_showcase",
    "write_ablation",
    "write_assessment",
    "write_clips",
    "write_compared",
    "write_comparison",
    "write_curve",
    "write_hardening",
    "write_report",
]
