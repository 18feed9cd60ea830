"""MMDetection's detectors behind the common interface, where MMDetection 3 is installed.

A configuration of MMDetection is a Python file, so reading one runs it. Here only its JSON dump is read, and only what
describes the network. Types in it are names that MMDetection's registry knows: a dotted name would make the registry
import and call whatever it points to, and is refused.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from ...contract import RaucaError
from ..classes import class_list, require_names
from ..families import MMDET_INSTALL, Resolved
from ..foreign import changed, first_line
from ..interface import DensePredictions, Detections
from ..nms import SinglePassDetector
from .checkpoint import fill, fingerprint, read_state
from .scaling import normalized, read_json
from .torchvision_ops import import_torchvision

DUMP = "python -c \"from mmengine import Config; Config.fromfile('CONFIG.py').dump('CONFIG.json')\""

_KNOWN_STEPS = frozenset({"LoadImageFromFile", "Resize", "LoadAnnotations", "PackDetInputs"})


@dataclass(frozen=True)
class Preparation:
    """What the test pipeline and the data preprocessor do to an image.

    Attributes:
        scale: (longer, shorter) side that bounds the scaled image, or its (width, height) where the aspect is not kept.
        keep_ratio: whether the aspect is kept.
        mean, std: of the channels in the network's order, for values in 0..255.
        rgb: whether the network's order is red, green, blue; else it is reversed.
        divisor: height and width are filled up to a multiple of this, at the right and at the bottom.
        fill: the value there, after normalization.
    """

    scale: tuple[int, int]
    keep_ratio: bool
    mean: tuple[float, ...]
    std: tuple[float, ...]
    rgb: bool
    divisor: int
    fill: float

    def fit(self, name: str, images: Tensor) -> tuple[Tensor, tuple[int, int]]:
        """(B, 3, H, W) sRGB in [0, 1] to the network's input, contiguous, and the size of the image in it.

        Images come with their channels last in memory, where mmcv's RoIAlign on a CPU takes them for contiguous: what
        it pooled would be wrong without a word.
        """
        height, width = self.size_of(images.shape[2], images.shape[3])
        if min(height, width) < 1:
            raise RaucaError(f"{name}: images of {images.shape[3]} x {images.shape[2]} pixels are too narrow")
        images = functional.interpolate(images, (height, width), mode="bilinear", align_corners=False)
        images = normalized(255 * (images if self.rgb else images.flip(1)), self.mean, self.std)
        right, bottom = -width % self.divisor, -height % self.divisor
        return functional.pad(images, (0, right, 0, bottom), value=self.fill).contiguous(), (height, width)

    def size_of(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) that an image is scaled to, rounded as MMDetection rounds."""
        if not self.keep_ratio:
            return self.scale[1], self.scale[0]
        factor = min(max(self.scale) / max(height, width), min(self.scale) / min(height, width))
        return int(height * factor + 0.5), int(width * factor + 0.5)


def read_config(path: Path) -> tuple[dict[str, Any], Preparation]:
    """The network's description and the preparation of its images.

    Raises:
        RaucaError: not a JSON dump, types that are not plain names, preparation that is not known here.
    """
    if path.suffix != ".json":
        raise RaucaError(f"{path}: a configuration in Python would be run; dump it as JSON where you trust it: {DUMP}")
    config = read_json(path)
    model = config.get("model")
    if not isinstance(model, dict) or not isinstance(model.get("data_preprocessor"), dict):
        raise RaucaError(f"{path}: describes no model of MMDetection 3; make it with: {DUMP}")
    _check_types(path, model)
    try:
        return _without_pretraining(model), _preparation(path, config, model["data_preprocessor"])
    except (KeyError, TypeError, ValueError, IndexError, StopIteration, OverflowError, AttributeError) as error:
        raise RaucaError(f"{path}: its test pipeline or data_preprocessor is not understood ({error!r})") from error


def _check_types(path: Path, value: Any) -> None:
    if isinstance(value, dict):
        kind = value.get("type", "plain")
        if not isinstance(kind, str) or not kind.isidentifier():
            raise RaucaError(f"{path}: type {kind!r} is not the name of a registered module; dotted names are refused")
        value = list(value.values())
    if isinstance(value, list):
        for one in value:
            _check_types(path, one)


def _without_pretraining(value: Any) -> Any:
    """``init_cfg`` names weights that would be downloaded, to be overwritten by the checkpoint's."""
    if isinstance(value, dict):
        return {key: _without_pretraining(one) for key, one in value.items() if key not in ("init_cfg", "pretrained")}
    return [_without_pretraining(one) for one in value] if isinstance(value, list) else value


def _preparation(path: Path, config: dict[str, Any], preprocessor: dict[str, Any]) -> Preparation:
    if preprocessor["type"] != "DetDataPreprocessor":
        raise RaucaError(f"{path}: data_preprocessor {preprocessor['type']} is not supported")
    steps = config["test_dataloader"]["dataset"]["pipeline"]
    unknown = [step["type"] for step in steps if step["type"] not in _KNOWN_STEPS]
    if unknown:
        raise RaucaError(f"{path}: step {unknown[0]} of its test pipeline is not supported")
    resize = next(step for step in steps if step["type"] == "Resize")
    mean, std = (tuple(map(float, preprocessor[key])) for key in ("mean", "std"))
    longer, shorter = (int(one) for one in resize["scale"])
    return Preparation(
        scale=(longer, shorter),
        keep_ratio=bool(resize.get("keep_ratio", False)),
        mean=mean,
        std=std,
        rgb=bool(preprocessor.get("bgr_to_rgb", False)),
        divisor=int(preprocessor.get("pad_size_divisor", 1)),
        fill=float(preprocessor.get("pad_value", 0)),
    )


# Candidates of an image that dense looks at: the best so many of those more probable than this.
_CANDIDATES = 1000
_LEAST_SCORE = 1e-3


class MmdetDetector(SinglePassDetector):
    """A detector of MMDetection 3 (Dynamic R-CNN, Sparse R-CNN and the rest).

    Everything is MMDetection's own ``predict``, which lets gradients through. ``dense`` runs it with nothing
    suppressed: up to 1000 pairs of box and category with a score above 0.001, each with its category's score alone;
    ``objectness`` is 1, or 0 where an image has fewer. ``detect`` runs it with the caller's thresholds; detectors
    without suppression (Sparse R-CNN, the DETRs) leave ``iou_threshold`` unused.

    MMDetection is no dependency of this project and its compiled operators are not part of the package index, so the
    project's tests predict with it only where it happens to be installed. The adapter was checked by hand against
    MMDetection 3.3 with random weights of Dynamic R-CNN, Sparse R-CNN and RetinaNet, with this project's operators in
    place of MMCV's compiled ones.
    """

    def __init__(self, name: str, config: Path, checkpoint: Path, class_names: tuple[str, ...] | None = None) -> None:
        """Build the network of ``config`` and read ``checkpoint``.

        Args:
            config: the JSON dump of a configuration, made by :data:`DUMP`.
            checkpoint: ``.pth`` that holds tensors and plain values only, or ``.safetensors``.
            class_names: None for COCO's 80.

        Raises:
            RaucaError: MMDetection is missing, a configuration or checkpoint that is unreadable or does not fit.
        """
        described, self._preparation = read_config(config)
        registry = import_registry()
        try:
            model = registry.build(importlib.import_module("mmengine.config").ConfigDict(described))
        except Exception as error:  # whatever a module's constructor makes of wrong options
            raise RaucaError(f"{config}: MMDetection cannot build this model ({first_line(error)})") from error
        fill(model, read_state(checkpoint), checkpoint)
        self.name = name
        self.class_names = class_list("coco-80") if class_names is None else class_names
        require_names(name, _classes_of(model), self.class_names)
        self.network = model.eval().requires_grad_(False)
        digest = hashlib.sha256(config.read_bytes()).hexdigest()
        self.fingerprint = fingerprint(model, self.class_names, self._preparation, digest)

    def _predict(self, images: Tensor) -> DensePredictions:
        most = min(_CANDIDATES, _pairs_of(self.network) or _CANDIDATES)
        with _undetached(self.network):
            found = self._final(images, _LEAST_SCORE, 1.0, most)  # no overlap exceeds 1
        if torch.is_grad_enabled() and images.requires_grad and not found[0].scores.requires_grad:
            raise RaucaError(f"{self.name}: this head of MMDetection gives no gradients; use it for detection only")
        classes = [one.scores[:, None] * functional.one_hot(one.labels, len(self.class_names)) for one in found]
        boxes = [one.boxes for one in found]
        ones = [torch.ones_like(one.scores) for one in found]
        padded = [pad_sequence(one, batch_first=True) for one in (boxes, ones, classes)]
        return DensePredictions(padded[0], padded[1], padded[2])

    def _final(
        self, images: Tensor, score_threshold: float, iou_threshold: float, most: int | None = None
    ) -> list[Detections]:
        batch, size = self._preparation.fit(self.name, images)
        padded = tuple(batch.shape[2:])
        known = {"img_shape": size, "ori_shape": size, "pad_shape": padded, "batch_input_shape": padded}
        sample = importlib.import_module("mmdet.structures").DetDataSample
        samples = [sample(metainfo=known | {"scale_factor": (1.0, 1.0)}) for _ in images]
        holder = self.network.roi_head if hasattr(self.network, "roi_head") else self.network.bbox_head
        with changed(holder, test_cfg=_limited(holder, score_threshold, iou_threshold, most)):
            predicted = self.network.predict(batch, samples, rescale=False)
        scale = batch.new_tensor([images.shape[3] / size[1], images.shape[2] / size[0]] * 2)
        return [_sorted(sample.pred_instances, scale, score_threshold) for sample in predicted]


def load(found: Resolved, size: int | None) -> MmdetDetector:
    """Of a folder with a dumped configuration and a checkpoint; the size is the configuration's."""
    files = []
    for pattern in ("*.json", "*.pth"):
        held = sorted(found.files[0].glob(pattern))
        if len(held) != 1:
            raise RaucaError(f"{found.files[0]}: must hold exactly one {pattern}, found {len(held)}")
        files += held
    config, checkpoint = files
    return MmdetDetector(found.name, config, checkpoint, found.class_names)


def import_registry() -> Any:
    """MMDetection's registry of models; raises :class:`RaucaError` where it is not installed, or too old or new."""
    import_torchvision()
    try:
        importlib.import_module("mmdet.utils").register_all_modules()
        return importlib.import_module("mmdet.registry").MODELS
    except (ImportError, AssertionError) as error:  # mmdet asserts the version of mmcv
        raise RaucaError(
            f"MMDetection 3 cannot be imported ({first_line(error)}); install it with: {MMDET_INSTALL}"
        ) from error


def _sorted(instances: Any, scale: Tensor, score_threshold: float) -> Detections:
    order = instances.scores.argsort(descending=True, stable=True)
    order = order[instances.scores[order] > score_threshold]
    return Detections(instances.bboxes[order] * scale, instances.scores[order], instances.labels[order])


def _classes_of(model: Any) -> int:
    head = model.roi_head.bbox_head if hasattr(model, "roi_head") else model.bbox_head
    return int((head[-1] if hasattr(head, "__getitem__") else head).num_classes)


def _pairs_of(model: Any) -> int:
    """Pairs of query and category in detectors with a fixed number of queries, which cannot give more; else 0."""
    queries = getattr(model, "num_queries", 0) or getattr(getattr(model, "rpn_head", None), "num_proposals", 0)
    return int(queries) * _classes_of(model)


@contextlib.contextmanager
def _undetached(model: Any) -> Iterator[None]:
    """One-stage heads take an image's predictions out of the batch with a function that detaches them by default."""
    name = "select_single_mlvl"
    kinds = () if hasattr(model, "roi_head") else type(model.bbox_head).__mro__

    def attached(tensors: list[Tensor], index: int, detach: bool = False) -> list[Tensor]:
        return [one[index] for one in tensors]

    with contextlib.ExitStack() as stack:
        for module in {sys.modules[kind.__module__] for kind in kinds if hasattr(sys.modules[kind.__module__], name)}:
            stack.enter_context(changed(module, **{name: attached}))
        yield


def _limited(holder: Any, score: float, iou: float, most: int | None) -> Any:
    """A head's limits with the caller's in their place; those that a detector does not have stay away."""
    limits = dict(holder.test_cfg)
    if "score_thr" in limits:
        limits["score_thr"] = score
    if "nms" in limits:
        limits["nms"] = dict(limits["nms"], iou_threshold=iou)
    if most is not None:
        limits["max_per_img"] = most
    return type(holder.test_cfg)(limits)
