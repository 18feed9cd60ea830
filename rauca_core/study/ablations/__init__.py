"""Ablations: variants of the optimization, all measured on the same held-out views, beside what the paper printed."""

from .catalogue import EXPERIMENTS, experiment_named
from .experiment import DEFAULT, QUICK, Claim, Experiment, Sizes, Variant
from .findings import Findings

__all__ = [
    "DEFAULT",
    "EXPERIMENTS",
    "QUICK",
    "Claim",
    "Experiment",
    "Findings",
    "Sizes",
    "Variant",
    "experiment_named",
]
