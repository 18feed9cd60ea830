"""A darknet network as a differentiable module, built from its cfg."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import torch
from torch import Tensor, nn

from .cfg import Section, read_cfg
from .dry_run import MAX_PARAMETERS
from .heads import Head, concatenate
from .interface import DensePredictions
from .layers import ACTIVATIONS, Convolution, MaxPool, Route, Shape, Shortcut, Upsample

MAX_LAYERS = 1000  # YOLOv4 has 161
MAX_SCALE = 2**12  # from the input's pixels to the coarsest cell, or back; published networks reach 32


class DarknetNetwork(nn.Module):
    """The layers of a cfg; weights are zero until :func:`read_weights` fills them.

    Attributes:
        layers: one module per section, in the cfg's order.
        stride: the coarsest grid cell, pixels; any input size that is a multiple of it works.
        classes: how many categories every head predicts.
    """

    def __init__(self, cfg: Path) -> None:
        super().__init__()
        net, sections = read_cfg(cfg)
        if len(sections) > MAX_LAYERS:
            raise net.error(f"{len(sections)} layers; at most {MAX_LAYERS} are read")
        build = _Builder(net.integer("channels", 3, 3, 3))
        self.layers = nn.ModuleList([build.add(section) for section in sections])
        self.stride = int(max(build.scales))
        heads = [layer for layer in self.layers if isinstance(layer, Head)]
        if not heads:
            raise net.error("the network has no [yolo] or [region] head")
        self.classes = heads[0].classes
        if any(head.classes != self.classes for head in heads):
            raise net.error("the heads disagree about the number of classes")
        wanted = {s for layer in self.layers if isinstance(layer, Route | Shortcut) for s in layer.sources}
        self._kept = frozenset(wanted)
        self.eval()
        # oneDNN's and cuDNN's own layout: forward plus backward takes 0.6 to 0.8 of the time on a CPU.
        for layer in self.layers:
            if isinstance(layer, Convolution):
                layer.weight.data = layer.weight.data.contiguous(memory_format=torch.channels_last)

    def forward(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1], H and W multiples of ``stride``; boxes in their pixels."""
        x, found = images.contiguous(memory_format=torch.channels_last), []
        outputs: dict[int, Tensor] = {}
        for index, layer in enumerate(self.layers):
            if isinstance(layer, Head):
                found.append(layer(x, images.shape[2], images.shape[3]))
            elif isinstance(layer, Route):
                x = layer(*(outputs[source] for source in layer.sources))
            elif isinstance(layer, Shortcut):
                x = layer(x, outputs[layer.sources[-1]])
            else:
                x = layer(x)
            if index in self._kept:
                outputs[index] = x
        return concatenate(found)

    def shapes(self, size: int) -> Iterator[Shape]:
        """What each layer makes of one image of (3, size, size); a layer that would fail raises :class:`ValueError`."""
        made: list[Shape] = []
        here: Shape = (3, size, size)
        for layer in self.layers:
            if isinstance(layer, Route):
                here = layer.shape(*(made[source] for source in layer.sources))
            elif isinstance(layer, Shortcut):
                here = layer.shape(here, made[layer.sources[-1]])
            elif isinstance(layer, Convolution | MaxPool | Upsample):
                here = layer.shape(here)
            made.append(here)
            yield here


class _Builder:
    """Turns sections into modules, following channels and scale so that a wrong cfg is caught here."""

    def __init__(self, channels: int) -> None:
        self._channels = [channels]  # entry i + 1 leaves layer i
        self.scales = [1.0]
        self._parameters = 0
        self._makers: dict[str, Callable[[Section], nn.Module]] = {
            "convolutional": self._convolution,
            "maxpool": self._maxpool,
            "route": self._route,
            "shortcut": self._shortcut,
            "upsample": self._upsample,
            "yolo": self._yolo,
            "region": self._region,
        }

    def add(self, section: Section) -> nn.Module:
        self._next_channels, self._next_scale = self._channels[-1], self.scales[-1]
        module = self._makers[section.kind](section)
        if not 1 / MAX_SCALE <= self._next_scale <= MAX_SCALE:
            raise section.error(f"scales the image by more than {MAX_SCALE}")
        self._channels.append(self._next_channels)
        self.scales.append(self._next_scale)
        return module

    def _convolution(self, section: Section) -> nn.Module:
        size, stride = section.integer("size", 1, 1, 31), section.integer("stride", 1, 1, 32)
        padding = size // 2 if section.integer("pad", 0, 0, 1) else section.integer("padding", 0, 0, 31)
        filters = section.integer("filters", None, 1)
        normalized = bool(section.integer("batch_normalize", 0, 0, 1))
        activation = section.choice("activation", ACTIVATIONS, "linear")
        self._parameters += filters * self._channels[-1] * size * size
        if self._parameters > MAX_PARAMETERS:
            raise section.error(f"more than {MAX_PARAMETERS} weights up to here; too large a network")
        self._next_channels, self._next_scale = filters, self.scales[-1] * stride
        return Convolution(self._channels[-1], filters, size, stride, padding, normalized, activation)

    def _maxpool(self, section: Section) -> nn.Module:
        size = section.integer("size", None, 1, 31)
        stride = section.integer("stride", 1, 1, 32)
        self._next_scale = self.scales[-1] * stride
        return MaxPool(size, stride, section.integer("padding", size - 1, 0, 31))

    def _sources(self, section: Section, option: str) -> list[int]:
        here = len(self._channels) - 1
        sources = [value if value >= 0 else here + value for value in section.integers(option)]
        if not all(0 <= source < here for source in sources):
            raise section.error(f"{option} points outside the {here} layers before it", option)
        if len({self.scales[source + 1] for source in sources}) != 1:
            raise section.error(f"{option} joins layers of different sizes", option)
        return sources

    def _route(self, section: Section) -> nn.Module:
        sources = self._sources(section, "layers")
        groups = section.integer("groups", 1, 1)
        group_id = section.integer("group_id", 0, 0, groups - 1)
        if any(self._channels[source + 1] % groups for source in sources):
            raise section.error(f"{groups} groups do not divide the channels evenly", "groups")
        self._next_channels = sum(self._channels[source + 1] // groups for source in sources)
        self._next_scale = self.scales[sources[0] + 1]
        return Route(sources, groups, group_id)

    def _shortcut(self, section: Section) -> nn.Module:
        sources = self._sources(section, "from")
        here = (self._channels[-1], self.scales[-1])
        if len(sources) != 1 or (self._channels[sources[0] + 1], self.scales[sources[0] + 1]) != here:
            raise section.error("from must name one layer of the same shape", "from")
        return Shortcut(sources, section.choice("activation", ACTIVATIONS, "linear"))

    def _upsample(self, section: Section) -> nn.Module:
        stride = section.integer("stride", 2, 1, 32)
        self._next_scale = self.scales[-1] / stride
        return Upsample(stride)

    def _yolo(self, section: Section) -> nn.Module:
        anchors = self._anchors(section)
        mask = section.integers("mask", list(range(len(anchors))), 0, len(anchors) - 1)
        scale_x_y = section.floats("scale_x_y", [1.0])
        return self._head(section, anchors[mask], scale_x_y[0], region=False)

    def _region(self, section: Section) -> nn.Module:
        if section.integer("coords", 4) != 4 or section.integer("softmax", 0) != 1:
            raise section.error("only coords=4 and softmax=1 are supported")
        return self._head(section, self._anchors(section), 1.0, region=True)

    def _anchors(self, section: Section) -> Tensor:
        values = section.floats("anchors")
        if len(values) != 2 * section.integer("num", len(values) // 2):
            raise section.error(f"{len(values)} anchor values, expected two for each of num boxes", "anchors")
        return torch.tensor(values).view(-1, 2)

    def _head(self, section: Section, anchors: Tensor, scale_x_y: float, region: bool) -> nn.Module:
        classes = section.integer("classes", None, 1)
        expected = len(anchors) * (5 + classes)
        if self._channels[-1] != expected:
            raise section.error(f"needs {expected} channels, the layer before it makes {self._channels[-1]}")
        return Head(anchors, classes, scale_x_y, anchors_in_cells=region, softmax=region)
