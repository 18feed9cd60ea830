"""Detectors of the large frameworks. Each framework is imported when one of its detectors is made, not before."""

from .mmdet_detector import MmdetDetector
from .torchvision_detector import TorchvisionDetector
from .torchvision_ops import import_torchvision
from .transformers_detector import TransformersDetector
from .transformers_loading import import_transformers

__all__ = [
    "MmdetDetector",
    "TorchvisionDetector",
    "TransformersDetector",
    "import_torchvision",
    "import_transformers",
]
