"""Networks that come as graphs of other frameworks, as differentiable PyTorch and without those frameworks."""

from .caffe import CaffeSsdDetector
from .ssd import COCO_GAPS, COCO_IDS, SsdDetector
from .tensorflow import TfSsdDetector

__all__ = ["COCO_GAPS", "COCO_IDS", "CaffeSsdDetector", "SsdDetector", "TfSsdDetector"]
