"""Any program as a detector: a function from images to detections, to be evaluated, not attacked."""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Callable
from typing import Any, NoReturn

from torch import Tensor

from ..contract import RaucaError
from ..contract.schema import is_plain_name
from .answers import above, read_answers
from .interface import Detections
from .nms import SinglePassDetector


class CallableDetector(SinglePassDetector):
    """A function behind :class:`rauca_core.detect.Detector`.

    It is given a batch as a float32 tensor (B, 3, H, W) on the CPU, sRGB in [0, 1], and returns what
    :func:`rauca_core.detect.answers.read_answers` reads: its final detections, which ``detect`` suppresses no further
    (``iou_threshold`` is unused). Average precision counts unsure detections too: it should keep those above 0.005.
    """

    network = None

    def __init__(self, function: Callable[[Tensor], Any], class_names: tuple[str, ...], fingerprint: str = "") -> None:
        """Take the function over.

        Args:
            class_names: that its labels are indices into.
            fingerprint: any text that stands for what the function computes: results are kept under it, and found
                again under the same. Without one nothing is known of the function, so that every detector made of it
                is another, and no result kept before is taken for its own.
        """
        usual = getattr(function, "__name__", type(function).__name__)
        self.name = usual if is_plain_name(usual) and "<" not in usual else "callable"
        self.class_names, self._function = class_names, function
        known = json.dumps(["callable", fingerprint or uuid.uuid4().hex, class_names])
        self.fingerprint = hashlib.sha256(known.encode()).hexdigest()

    def _predict(self, images: Tensor) -> NoReturn:
        raise RaucaError(
            f"{self.name}: a callable gives no gradient; attack another detector and evaluate on this one, or load the "
            "network itself, as a file or an nn.Module"
        )

    def _final(self, images: Tensor, score_threshold: float, iou_threshold: float) -> list[Detections]:
        found = read_answers(self.name, self._function(images.cpu().contiguous()), images, self.class_names)
        return above(found, score_threshold)
