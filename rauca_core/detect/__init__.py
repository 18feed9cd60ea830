"""Detectors: one interface, an adapter per family, and the registry of their weights."""

from .darknet import DarknetDetector
from .interface import DensePredictions, Detections, Detector
from .load import load_detector, resolve
from .nms import box_iou
from .scoring import car_score, class_index
from .sources import SOURCES, Source
from .store import WeightsStatus, fetch, status, weights_folder

__all__ = [
    "SOURCES",
    "DarknetDetector",
    "DensePredictions",
    "Detections",
    "Detector",
    "Source",
    "WeightsStatus",
    "box_iou",
    "car_score",
    "class_index",
    "fetch",
    "load_detector",
    "resolve",
    "status",
    "weights_folder",
]
