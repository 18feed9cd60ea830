"""Darknet's network description, read strictly.

A network that is read wrongly still detects a little, so anything that could change the computation and is not known
here is refused by name, file and line; options that only matter for training are skipped.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ..contract import RaucaError
from ..contract.reading import read_text

MAX_CFG_BYTES = 2**20

ARCHITECTURE: dict[str, frozenset[str]] = {
    "net": frozenset({"width", "height", "channels"}),
    "convolutional": frozenset({"batch_normalize", "filters", "size", "stride", "pad", "padding", "activation"}),
    "maxpool": frozenset({"size", "stride", "padding"}),
    "route": frozenset({"layers", "groups", "group_id"}),
    "upsample": frozenset({"stride"}),
    "shortcut": frozenset({"from", "activation"}),
    "yolo": frozenset({"mask", "anchors", "classes", "num", "scale_x_y"}),
    "region": frozenset({"anchors", "classes", "coords", "num", "softmax"}),
}

# Options that only matter while training, whichever section they stand in.
# fmt: off
_TRAINING_ONLY = frozenset((
    "batch", "subdivisions", "momentum", "decay", "angle", "saturation", "exposure", "hue", "learning_rate",
    "burn_in", "max_batches", "policy", "steps", "scales", "mosaic", "cutmix", "letter_box", "optimized_memory",
    "ema_alpha", "label_smooth_eps", "stopbackward", "jitter", "ignore_thresh", "truth_thresh", "random", "resize",
    "iou_loss", "iou_normalizer", "cls_normalizer", "obj_normalizer", "iou_thresh", "max_delta", "nms_kind",
    "beta_nms", "bias_match", "rescore", "object_scale", "noobject_scale", "class_scale", "coord_scale", "absolute",
    "thresh",
))
# fmt: on


@dataclass
class Section:
    """One ``[section]`` of a cfg: its kind, where it stands, and its options."""

    kind: str
    path: Path
    line: int
    options: dict[str, tuple[str, int]] = field(default_factory=dict)

    def error(self, what: str, option: str | None = None) -> RaucaError:
        """A :class:`RaucaError` that points at this section, or at the line of one of its options."""
        line = self.options[option][1] if option in self.options else self.line
        return RaucaError(f"{self.path}:{line}: [{self.kind}] {what}")

    def integer(self, name: str, default: int | None = None, minimum: int = 0, maximum: int = 65536) -> int:
        return self.integers(name, None if default is None else [default], minimum, maximum, single=True)[0]

    def integers(
        self,
        name: str,
        default: list[int] | None = None,
        minimum: int = -65536,
        maximum: int = 65536,
        single: bool = False,
    ) -> list[int]:
        if name not in self.options and default is not None:
            return default
        wanted = "a whole number" if single else "whole numbers separated by commas"
        try:
            values = [int(part) for part in self._text(name).split(",")]
        except ValueError:
            raise self.error(f"{name} must be {wanted}, not {self._text(name)!r}", name) from None
        if (single and len(values) != 1) or not all(minimum <= value <= maximum for value in values):
            raise self.error(f"{name} must be {wanted} between {minimum} and {maximum}", name)
        return values

    def floats(self, name: str, default: list[float] | None = None) -> list[float]:
        if name not in self.options and default is not None:
            return default
        try:
            values = [float(part) for part in self._text(name).split(",")]
        except ValueError:
            raise self.error(f"{name} must be numbers separated by commas, not {self._text(name)!r}", name) from None
        if not all(abs(value) < 1e6 for value in values):
            raise self.error(f"{name} must be finite numbers", name)
        return values

    def choice(self, name: str, known: tuple[str, ...], default: str) -> str:
        value = self._text(name) if name in self.options else default
        if value not in known:
            raise self.error(f"{name} {value!r} is not supported; known are {', '.join(known)}", name)
        return value

    def _text(self, name: str) -> str:
        if name not in self.options:
            raise self.error(f"option {name} is missing")
        return self.options[name][0]


def read_cfg(path: Path) -> tuple[Section, list[Section]]:
    """Read a cfg file.

    Returns:
        The ``[net]`` section and the layers in order.

    Raises:
        RaucaError: missing file, unknown section or option, malformed line; names file and line.
    """
    sections: list[Section] = []
    for number, raw in enumerate(read_text(path, MAX_CFG_BYTES, "a darknet cfg").splitlines(), start=1):
        line = raw.strip()
        if line and line[0] not in "#;":
            _read_line(path, number, line, sections)
    if not sections or sections[0].kind not in ("net", "network"):
        raise RaucaError(f"{path}: does not begin with a [net] section; this is not a darknet cfg")
    if len(sections) == 1:
        raise RaucaError(f"{path}: holds no layers")
    return sections[0], sections[1:]


def _read_line(path: Path, number: int, line: str, sections: list[Section]) -> None:
    where = f"{path}:{number}"
    if line[0] == "[":
        kind = line[1:-1].strip()
        kind = "net" if kind == "network" else kind
        if line[-1] != "]" or kind not in ARCHITECTURE:
            raise RaucaError(f"{where}: section {line} is not supported; known are {', '.join(ARCHITECTURE)}")
        if kind == "net" and sections:
            raise RaucaError(f"{where}: a second [net] section")
        sections.append(Section(kind, path, number))
        return
    name, equals, value = (part.strip() for part in line.partition("="))
    if not equals or not name or not value:
        raise RaucaError(f"{where}: expected `option=value`, found {line[:60]!r}")
    if not sections:
        raise RaucaError(f"{where}: option {name} stands before any section")
    section = sections[-1]
    if name in section.options:
        raise RaucaError(f"{where}: [{section.kind}] option {name} is given twice")
    if name in ARCHITECTURE[section.kind]:
        section.options[name] = (value, number)
    elif name not in _TRAINING_ONLY:
        raise RaucaError(f"{where}: [{section.kind}] option {name} is not supported")
