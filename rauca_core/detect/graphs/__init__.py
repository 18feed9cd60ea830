"""Networks that come as graphs of other frameworks, as differentiable PyTorch and without those frameworks."""

from .caffe import CaffeSsdDetector
from .labels import COCO_GAPS, COCO_IDS
from .ssd import SsdDetector
from .tensorflow import TfSsdDetector

__all__ = ["COCO_GAPS", "COCO_IDS", "CaffeSsdDetector", "SsdDetector", "TfSsdDetector"]
