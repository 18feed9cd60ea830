"""The attack: losses, random output augmentation, the optimizer and the baselines it is compared with."""

from .augmentation import Augmentation
from .ensemble import DetectorEnsemble
from .history import StepReport, read_history
from .losses import attack_loss, box_overlap, detection_score
from .methods import FEW_STEPS, METHODS, method_named, settings_of
from .optimizer import load_attacked, optimize, run_optimization
from .paint import Paint, load_paint, random_camouflage
from .paint_losses import SmoothLoss
from .renderer import Renderer
from .settings import OptimizerSettings, make_settings

__all__ = [
    "FEW_STEPS",
    "METHODS",
    "Augmentation",
    "DetectorEnsemble",
    "OptimizerSettings",
    "Paint",
    "Renderer",
    "SmoothLoss",
    "StepReport",
    "attack_loss",
    "box_overlap",
    "detection_score",
    "load_attacked",
    "load_paint",
    "make_settings",
    "method_named",
    "optimize",
    "random_camouflage",
    "read_history",
    "run_optimization",
    "settings_of",
]
