"""The attack: losses, random output augmentation, the optimiser and the baselines it is compared with."""

from .augmentation import Augmentation
from .baselines import plain_camouflage, random_camouflage
from .journal import StepReport, read_history
from .losses import SmoothLoss, attack_loss, box_overlap, detection_score
from .optimiser import optimise
from .panel import Panel
from .settings import OptimiserSettings, make_settings

__all__ = [
    "Augmentation",
    "OptimiserSettings",
    "Panel",
    "SmoothLoss",
    "StepReport",
    "attack_loss",
    "box_overlap",
    "detection_score",
    "make_settings",
    "optimise",
    "plain_camouflage",
    "random_camouflage",
    "read_history",
]
