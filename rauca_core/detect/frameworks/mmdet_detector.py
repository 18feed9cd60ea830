"""MMDetection's detectors behind the common interface, where MMDetection 3 is installed."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from ...contract import RaucaError
from ..classes import class_list, read_names, require_names
from ..families import MMDET_INSTALL, Resolved
from ..foreign import changed, first_line
from ..interface import DensePredictions, Detections
from ..nms import SinglePassDetector
from ..synth.network import Truth
from .checkpoint import fill, fingerprint, read_checkpoint, tensors_of
from .mmdet_config import names_of, read_config
from .torchvision_ops import import_torchvision

PLAIN = (
    "python -c \"import torch; held = torch.load('CHECKPOINT', map_location='cpu', weights_only=False); "
    "torch.save({key: held[key] for key in ('meta', 'state_dict')}, 'PLAIN.pth')\""
)
"""Leaves of a training's checkpoint what a detector is; run where the checkpoint is trusted."""

# Candidates of an image that dense looks at: the best so many of those more probable than this.
_CANDIDATES = 1000
_LEAST_SCORE = 1e-3


class MmdetDetector(SinglePassDetector):
    """A detector of MMDetection 3 (Dynamic R-CNN, Sparse R-CNN and the rest).

    Everything is MMDetection's own ``predict``, which lets gradients through. ``dense`` runs it with nothing
    suppressed: up to 1000 pairs of box and category with a score above 0.001, each with its category's score alone;
    ``objectness`` is 1, or 0 where an image has fewer. ``detect`` runs it with the caller's thresholds; detectors
    without suppression (Sparse R-CNN, the DETRs) leave ``iou_threshold`` unused.

    MMDetection is no dependency of this project. Its tests hold seeded networks of six kinds to MMDetection 3.3's own
    ``test_step``, with this project's operators in place of MMCV's compiled ones.
    """

    def __init__(self, name: str, config: Path, checkpoint: Path, class_names: tuple[str, ...] | None = None) -> None:
        """Build the network of ``config`` and read ``checkpoint``.

        Args:
            config: see :func:`rauca_core.detect.frameworks.mmdet_config.read_config`.
            checkpoint: ``.pth`` that holds tensors and plain values only, or ``.safetensors``.
            class_names: None for those of the checkpoint, else of the configuration, else COCO's 80: the first list of
                as many as the head has classes.

        Raises:
            RaucaError: MMDetection is missing, a configuration or checkpoint that is unreadable or does not fit,
                classes that nothing names.
        """
        described = read_config(config)
        registry = import_registry()
        try:
            model = registry.build(importlib.import_module("mmengine.config").ConfigDict(described.model))
        except Exception as error:  # whatever a module's constructor makes of wrong options
            raise RaucaError(f"{config}: MMDetection cannot build this model ({first_line(error)})") from error
        held = read_checkpoint(checkpoint, f"save it anew, where you trust it: {PLAIN}")
        fill(model, tensors_of(held, checkpoint), checkpoint)
        self.name = name
        known = _named_in(held), described.class_names, class_list("coco-80")
        self.class_names = class_names or _fitting(checkpoint, _classes_of(model), known)
        require_names(name, _classes_of(model), self.class_names)
        self.network = model.eval().requires_grad_(False)
        self._preparation = described.preparation
        digest = hashlib.sha256(config.read_bytes()).hexdigest()
        self.fingerprint = fingerprint(model, self.class_names, self._preparation, digest)

    def _predict(self, images: Tensor) -> DensePredictions:
        most = min(_CANDIDATES, _pairs_of(self.network) or _CANDIDATES)
        with _undetached(self.network):
            whole = self._final(images, _LEAST_SCORE, 1.0, most)  # no overlap exceeds 1
        found = [
            Detections(one.boxes[:most], one.scores[:most], one.labels[:most]) for one in whole
        ]  # YOLOX has no limit
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
        batch, samples, scale = self._prepared(images)
        holder, maskless = self._holder()
        limits = {"test_cfg": _limited(holder, score_threshold, iou_threshold, most)}
        with changed(holder, **limits, **maskless):
            predicted = self.network.predict(batch, samples, rescale=False)
        return [_sorted(sample.pred_instances, scale, score_threshold) for sample in predicted]

    @property
    def side(self) -> int:
        """The shorter side that images are scaled to, pixels."""
        return min(self._preparation.scale)

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """MMDetection's own losses, to be summed, of a network in training mode; boxes in the images' pixels.

        Masks are not learnt.
        """
        batch, samples, scale = self._prepared(images)
        instances = importlib.import_module("mmengine.structures").InstanceData
        for sample, truth in zip(samples, truths, strict=True):
            sample.gt_instances = instances(bboxes=truth.boxes / scale, labels=truth.labels)
        holder, maskless = self._holder()
        with changed(holder, **maskless):
            found = self.network.loss(batch, samples)
        parts = {name: one if isinstance(one, list) else [one] for name, one in found.items() if "loss" in name}
        return {name: torch.stack([one.mean() for one in some]).sum() for name, some in parts.items()}

    def _prepared(self, images: Tensor) -> tuple[Tensor, list[Any], Tensor]:
        """The network's batch, MMDetection's sample of each image, and what (4,) scales boxes there to the images'."""
        prepared = self._preparation.fit(self.name, images)
        batch, size, padded = prepared.batch, prepared.size, tuple(prepared.batch.shape[2:])
        known = {"img_shape": prepared.framed, "ori_shape": size, "pad_shape": padded, "batch_input_shape": padded}
        sample = importlib.import_module("mmdet.structures").DetDataSample
        samples = [sample(metainfo=known | {"scale_factor": (1.0, 1.0)}) for _ in images]
        return batch, samples, batch.new_tensor([images.shape[3] / size[1], images.shape[2] / size[0]] * 2)

    def _holder(self) -> tuple[Any, dict[str, None]]:
        """The head that holds the limits of a test, and what of it must be changed to leave masks out."""
        holder = self.network.roi_head if hasattr(self.network, "roi_head") else self.network.bbox_head
        return holder, {"mask_head": None} if hasattr(holder, "mask_head") else {}


def load(found: Resolved, size: int | None) -> MmdetDetector:
    """Of a folder with a configuration, a checkpoint and, where these do not name the classes, a ``.names``."""
    folder = found.files[0]
    config = _only(folder, "configuration", ".json") if any(folder.glob("*.json")) else None
    config = config or _only(folder, "configuration", ".py")
    checkpoint = _only(folder, "checkpoint", ".pth", ".safetensors")
    names = found.class_names
    if names is None and any(folder.glob("*.names")):
        names = read_names(_only(folder, "list of class names", ".names"))
    return MmdetDetector(found.name, config, checkpoint, names)


def _only(folder: Path, kind: str, *suffixes: str) -> Path:
    held = sorted(path for path in folder.iterdir() if path.suffix in suffixes)
    if len(held) != 1:
        found = ", ".join(path.name for path in held[:4]) or "none"
        raise RaucaError(f"{folder}: must hold exactly one {kind} ({' or '.join(suffixes)}), found {found}")
    return held[0]


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


def _named_in(checkpoint: object) -> tuple[str, ...]:
    """The class names that MMDetection 3, or 2, saved with the weights."""
    meta = checkpoint.get("meta") if isinstance(checkpoint, Mapping) else None
    return names_of(meta.get("dataset_meta", meta)) if isinstance(meta, dict) else ()


def _fitting(checkpoint: Path, count: int, known: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    for names in known:
        if len(names) == count:
            return names
    raise RaucaError(
        f"{checkpoint}: the network predicts {count} classes, and neither it nor its configuration names them; write "
        f"them, one per line, into {checkpoint.with_suffix('.names')}"
    )


def _pairs_of(model: Any) -> int:
    """Pairs of query and category in detectors with a fixed number of queries, which cannot give more; else 0."""
    queries = getattr(model, "num_queries", 0) or getattr(getattr(model, "rpn_head", None), "num_proposals", 0)
    return int(queries) * _classes_of(model)


@contextlib.contextmanager
def _undetached(model: Any) -> Iterator[None]:
    """Boxes and scores with their gradients, which MMDetection cuts off where it needs none itself.

    One-stage heads take an image's predictions out of the batch with a function that detaches them by default. Sparse
    R-CNN's last stage hands out detached boxes beside those that it computed.
    """
    head = getattr(model, "roi_head", None) or model.bbox_head
    with contextlib.ExitStack() as stack:
        if "SparseRoIHead" in [kind.__name__ for kind in type(head).__mro__]:
            head._bbox_forward = _last_attached(head)
            stack.callback(delattr, head, "_bbox_forward")
        modules = {sys.modules[kind.__module__] for kind in type(head).__mro__}
        for module in [one for one in modules if hasattr(one, "select_single_mlvl")]:
            stack.enter_context(changed(module, select_single_mlvl=_select_attached))
        yield


def _select_attached(tensors: list[Tensor], index: int, detach: bool = False) -> list[Tensor]:
    return [one[index] for one in tensors]


def _last_attached(head: Any) -> Any:
    """Sparse R-CNN's stage; the last one's boxes, (images * proposals, 4), are given image by image."""
    forward = head._bbox_forward

    def attached(stage: int, *given: Any, **more: Any) -> Any:
        found = forward(stage, *given, **more)
        if stage == head.num_stages - 1:
            counts = [len(one) for one in found["detached_proposals"]]
            found["detached_proposals"] = found["decoded_bboxes"].split(counts)
        return found

    return attached


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
