"""Detectors of the large frameworks. Each framework is imported when one of its detectors is made, not before."""

from .torchvision_detector import ARCHITECTURES, TorchvisionDetector
from .torchvision_ops import import_torchvision

__all__ = ["ARCHITECTURES", "TorchvisionDetector", "import_torchvision"]
