"""Any torch module that detects as torchvision's do, in memory or as a TorchScript archive.

Its final detections are all that is known of it. Where their scores have a gradient with respect to the image, an
attack goes through them: it reaches what the network still reports, and ends where nothing is reported.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import io
import re
import warnings
import zipfile
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import one_hot
from torch.nn.utils.rnn import pad_sequence

from ...contract import RaucaError
from ...contract.files import file_digest
from ...contract.reading import DAMAGED_ARCHIVE
from ..answers import above, read_answers
from ..batch_norm import freeze_batch_norms
from ..classes import canonical
from ..families import Resolved
from ..foreign import first_line
from ..interface import DensePredictions, Detections
from ..letterbox import Letterbox
from ..nms import SinglePassDetector
from .checkpoint import fingerprint
from .torchvision_ops import import_torchvision

MAX_CODE_BYTES = 2**24  # of an archive's programs; torchvision's Mask R-CNN has some 200 kB
# All that torch's operators do beside computing: write a file, map a file. `save : int` is an attribute of that name.
_FORBIDDEN = re.compile(rb"\b(?:from_file|save(?!\s*:))\b")
_FROM_ONE = ("FasterRCNN", "MaskRCNN", "KeypointRCNN", "SSD")  # torchvision's, whose label 0 is the background


class ModuleDetector(SinglePassDetector):
    """A module behind :class:`rauca_core.detect.Detector`.

    It is called with a list of (3, H, W) sRGB images in [0, 1] and returns what
    :func:`rauca_core.detect.answers.read_answers` reads, as torchvision's detectors do: its own final detections, which
    ``detect`` suppresses no further (``iou_threshold`` is unused).
    """

    def __init__(
        self, name: str, model: nn.Module, class_names: tuple[str, ...], size: int | None = None, digest: str = ""
    ) -> None:
        """Take a module over, in evaluation mode, and run it, so that one of another kind is met here.

        Args:
            class_names: that its labels are indices into. Archives of torchvision's models that count from 1 may leave
                the background out.
            size: the square that images are fitted into, pixels; None for images as they are.
            digest: of the file that it was read from.

        Raises:
            RaucaError: it takes no list of images, or answers something else.
        """
        named = canonical(class_names[0]) == "background"
        background = getattr(model, "original_name", "") in _FROM_ONE and not named
        self.name, self.size, self.class_names = name, size, ("background",) * background + class_names
        self.fingerprint = fingerprint(model, self.class_names, size, digest or _code(model))
        with contextlib.suppress(NotImplementedError):  # a module of torch.export has no other mode
            freeze_batch_norms(model)
        for parameter in model.parameters():
            parameter.requires_grad_(False)
        self.network, self._one_by_one = model, False
        images = torch.rand(2, 3, *[size or 320] * 2, generator=torch.Generator().manual_seed(0))
        self.detect(images[:1])
        try:
            self.detect(images)
        except RaucaError:  # exported, or traced, for a list of one
            self._one_by_one = True

    def _predict(self, images: Tensor) -> DensePredictions:
        found = self._reported(images)
        wanted = images.requires_grad and torch.is_grad_enabled()
        if wanted and any(len(one.scores) and not one.scores.requires_grad for one in found):
            raise RaucaError(
                f"{self.name}: its scores have no gradient (no_grad, detach or NumPy inside); attack another detector "
                "and evaluate on this one, or give the network without them"
            )
        ones = [torch.ones_like(one.scores) for one in found]
        classes = [one_hot(one.labels, len(self.class_names)) * one.scores[:, None] for one in found]
        parts = ([one.boxes for one in found], ones, classes)
        return DensePredictions(*(pad_sequence(part, batch_first=True) for part in parts))

    def _final(self, images: Tensor, score_threshold: float, iou_threshold: float) -> list[Detections]:
        return above(self._reported(images), score_threshold)

    def _reported(self, images: Tensor) -> list[Detections]:
        if self._one_by_one and len(images) > 1:
            return [found for one in images.split(1) for found in self._reported(one)]
        box = Letterbox(images.shape[2], images.shape[3], self.size or max(images.shape[2:]))
        fitted = box.fit(images) if self.size else images
        try:
            answers = self.network(list(fitted.contiguous()))
        except Exception as error:  # whatever a foreign network may raise
            raise RaucaError(
                f"{self.name}: cannot be called with a list of images (3, {fitted.shape[2]}, {fitted.shape[3]}) as "
                f"torchvision's detectors are ({first_line(error)}); put what it wants into a function and load that"
            ) from error
        if isinstance(answers, tuple) and len(answers) == 2 and answers[0] == {}:
            answers = answers[1]  # torchvision's models as TorchScript: losses come first
        found = read_answers(self.name, answers, fitted, self.class_names)
        return (
            [Detections(box.boxes_to_image(one.boxes), one.scores, one.labels) for one in found] if self.size else found
        )


def load(found: Resolved, size: int | None) -> ModuleDetector:
    """Of a TorchScript archive, which is a program: it is read only if it does nothing but compute."""
    path = found.files[0]
    _refuse_more_than_computing(path)
    with contextlib.suppress(RaucaError):
        import_torchvision()  # archives of its models call its operators
    try:
        with warnings.catch_warnings(action="ignore"):
            model = torch.jit.load(path, map_location="cpu")
    except (RuntimeError, ValueError) as error:
        raise RaucaError(f"{path}: cannot be read as TorchScript ({first_line(error)})") from error
    return ModuleDetector(found.name, model, found.names, size, file_digest(path))


def is_torchscript(path: Path) -> bool:
    """Whether a file is an archive of ``torch.jit.save``, by the names of its parts; nothing is unpickled."""
    try:
        with zipfile.ZipFile(path) as archive:
            parts = [name.partition("/")[2] for name in archive.namelist()]
    except DAMAGED_ARCHIVE:
        return False
    return "constants.pkl" in parts and any(part.startswith("code/") for part in parts)


def _refuse_more_than_computing(path: Path) -> None:
    if not is_torchscript(path):
        raise RaucaError(f"{path}: is no TorchScript archive; write one with torch.jit.script(model).save(PATH)")
    with zipfile.ZipFile(path) as archive:
        programs = [one for one in archive.infolist() if one.filename.endswith(".py")]
        if sum(one.file_size for one in programs) > MAX_CODE_BYTES:
            raise RaucaError(f"{path}: holds programs of more than {MAX_CODE_BYTES} bytes; none of that size is read")
        try:
            found = next(filter(None, (_FORBIDDEN.search(archive.read(one)) for one in programs)), None)
        except DAMAGED_ARCHIVE as error:
            raise RaucaError(f"{path}: cannot be read as TorchScript ({first_line(error)})") from error
    if found:
        raise RaucaError(f"{path}: its program says {found[0].decode()!r}, which may reach files; export it without")


def _code(model: nn.Module) -> str:
    """The programs of a module's parts that are not torch's, as far as they are known."""
    if isinstance(model, torch.jit.ScriptModule):
        buffer = io.BytesIO()
        with warnings.catch_warnings(action="ignore"):  # torch would rather have everything exported
            torch.jit.save(model, buffer)
        with zipfile.ZipFile(buffer) as archive:
            texts = [archive.read(name).decode() for name in archive.namelist() if name.endswith(".py")]
            settings = next(archive.read(name) for name in archive.namelist() if name.endswith("/data.pkl"))
        lines = sorted("\n".join(texts).splitlines())  # torch writes constants in any order
        return hashlib.sha256(repr((lines, settings)).encode()).hexdigest()
    if isinstance(model, torch.fx.GraphModule):  # of torch.export
        return model.code
    kinds = {type(part) for part in model.modules() if not type(part).__module__.startswith("torch.")}
    return "\n".join(sorted(map(_source, kinds)))


def _source(kind: type[Any]) -> str:
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # of a console, or made while the program runs
        return kind.__qualname__
