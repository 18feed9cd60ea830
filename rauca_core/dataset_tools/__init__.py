"""Looking after data sets: check them, look at them, hand them to other tools. NumPy and Pillow only."""

from .check import CheckResult, check_dataset
from .findings import Finding

__all__ = ["CheckResult", "Finding", "check_dataset"]
