"""Detectors: one interface, an adapter per family, and the registry of their weights."""

from .catalogue import SOURCES, Source
from .classes import canonical, class_index, class_list, find_class
from .darknet import DarknetDetector
from .interface import DensePredictions, Detections, Detector, check_images
from .load import load_detector, resolve
from .nms import box_iou
from .renaming import parse_classes, renamed
from .weights import fetch, status, weights_folder

__all__ = [
    "SOURCES",
    "DarknetDetector",
    "DensePredictions",
    "Detections",
    "Detector",
    "Source",
    "box_iou",
    "canonical",
    "check_images",
    "class_index",
    "class_list",
    "fetch",
    "find_class",
    "load_detector",
    "parse_classes",
    "renamed",
    "resolve",
    "status",
    "weights_folder",
]
