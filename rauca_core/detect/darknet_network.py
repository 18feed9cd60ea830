"""A darknet network as a differentiable module, built from its cfg.

Batch normalization is folded into the convolutions when the weights are read. Boxes are xyxy in pixels of the input.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from .cfg import Section, read_cfg
from .dry_run import MAX_PARAMETERS
from .interface import DensePredictions

ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {  # in place where the gradient allows
    "linear": lambda x: x,
    "leaky": lambda x: functional.leaky_relu(x, 0.1, inplace=True),
    "relu": lambda x: functional.relu(x, inplace=True),
    "mish": functional.mish,
}


class Convolution(nn.Module):
    """(B, inputs, H, W) -> (B, filters, H', W'): convolution, bias, activation.

    Attributes:
        normalized: the weights file holds batch-norm statistics for this layer, to be folded.
    """

    def __init__(
        self, inputs: int, filters: int, size: int, stride: int, padding: int, normalized: bool, activation: str
    ) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(filters, inputs, size, size), requires_grad=False)
        self.bias = nn.Parameter(torch.zeros(filters), requires_grad=False)
        self.stride = stride
        self.padding = padding
        self.normalized = normalized
        self.activation = activation

    def forward(self, x: Tensor) -> Tensor:
        x = functional.conv2d(x, self.weight, self.bias, self.stride, self.padding)
        return ACTIVATIONS[self.activation](x)


class MaxPool(nn.Module):
    """(B, C, H, W) -> (B, C, H', W') with darknet's padding, ``H' = (H + padding - size) // stride + 1``.

    ``padding`` is the total over both sides (``size - 1`` unless given); the odd pixel goes to the right and bottom.
    """

    def __init__(self, size: int, stride: int, padding: int) -> None:
        super().__init__()
        self.size = size
        self.stride = stride
        self.padding = padding

    def forward(self, x: Tensor) -> Tensor:
        left = self.padding // 2
        right, bottom = (self._trailing(extent, left) for extent in (x.shape[3], x.shape[2]))
        if left or right or bottom:
            x = functional.pad(x, (left, right, left, bottom), value=-torch.inf)
        return functional.max_pool2d(x, self.size, self.stride)

    def _trailing(self, extent: int, left: int) -> int:
        """Padding that the last window really reaches: padding a whole tensor for nothing costs as much as pooling."""
        last = (extent + self.padding - self.size) // self.stride
        return max(0, last * self.stride + self.size - extent - left)


class Route(nn.Module):
    """Concatenate earlier outputs along channels, or keep one of ``groups`` equal slices of each."""

    def __init__(self, sources: list[int], groups: int, group_id: int) -> None:
        super().__init__()
        self.sources = sources
        self.groups = groups
        self.group_id = group_id

    def forward(self, *inputs: Tensor) -> Tensor:
        slices = [x.chunk(self.groups, 1)[self.group_id] if self.groups > 1 else x for x in inputs]
        return slices[0] if len(slices) == 1 else torch.cat(slices, 1)


class Shortcut(nn.Module):
    """Add an earlier output of the same shape to the current one."""

    def __init__(self, sources: list[int], activation: str) -> None:
        super().__init__()
        self.sources = sources
        self.activation = activation

    def forward(self, *inputs: Tensor) -> Tensor:
        return ACTIVATIONS[self.activation](inputs[0] + inputs[1])


# A box cannot be exp(8) = 2981 times its anchor; beyond, exp() would reach infinity and its gradient NaN.
MAX_LOG_SIZE = 8.0


def precise(x: Tensor) -> Tensor:
    """At least float32: in half precision a box 400 pixels from the origin would jump in steps of two."""
    return x.float() if x.dtype in (torch.float16, torch.bfloat16) else x


class Head(nn.Module):
    """Decode (B, anchors * (5 + classes), h, w); predictions run over anchors, then rows, then columns.

    Args:
        anchors: (A, 2) width and height, pixels of the network's input or grid cells, see ``anchors_in_cells``.
        scale_x_y: YOLOv4's stretch of the center's sigmoid about 0.5.
        anchors_in_cells: anchors (and box sizes) are counted in grid cells, as in YOLOv2.
        softmax: classes exclude each other, as in YOLOv2; otherwise each has a sigmoid of its own.
    """

    anchors: Tensor

    def __init__(self, anchors: Tensor, classes: int, scale_x_y: float, anchors_in_cells: bool, softmax: bool) -> None:
        super().__init__()
        self.register_buffer("anchors", anchors, persistent=False)
        self.classes = classes
        self.scale_x_y = scale_x_y
        self.anchors_in_cells = anchors_in_cells
        self.softmax = softmax

    def forward(self, features: Tensor, input_height: int, input_width: int) -> DensePredictions:
        batch, _, rows, columns = features.shape
        x = precise(features).view(batch, len(self.anchors), 5 + self.classes, rows, columns).permute(0, 1, 3, 4, 2)
        stride = torch.tensor([input_width / columns, input_height / rows], dtype=x.dtype, device=x.device)
        grid_y, grid_x = torch.meshgrid(
            torch.arange(rows, dtype=x.dtype, device=x.device),
            torch.arange(columns, dtype=x.dtype, device=x.device),
            indexing="ij",
        )
        offset = x[..., 0:2].sigmoid() * self.scale_x_y - 0.5 * (self.scale_x_y - 1)
        center = (offset + torch.stack([grid_x, grid_y], -1)) * stride
        anchors = self.anchors.to(x.dtype) * (stride if self.anchors_in_cells else 1.0)
        half = 0.5 * x[..., 2:4].clamp(max=MAX_LOG_SIZE).exp() * anchors[:, None, None, :]
        classes = x[..., 5:].softmax(-1) if self.softmax else x[..., 5:].sigmoid()
        return DensePredictions(
            boxes=torch.cat([center - half, center + half], -1).reshape(batch, -1, 4),
            objectness=x[..., 4].sigmoid().reshape(batch, -1),
            classes=classes.reshape(batch, -1, self.classes),
        )


def run(layers: nn.ModuleList, images: Tensor, taps: Sequence[int] = ()) -> tuple[list[DensePredictions], list[Tensor]]:
    """What the heads among a network's layers predict, and the outputs of the layers ``taps``."""
    kept = {*taps, *(s for layer in layers if isinstance(layer, Route | Shortcut) for s in layer.sources)}
    x, found = images.contiguous(memory_format=torch.channels_last), []
    outputs: dict[int, Tensor] = {}
    for index, layer in enumerate(layers):
        if isinstance(layer, Head):
            found.append(layer(x, images.shape[2], images.shape[3]))
        elif isinstance(layer, Route):
            x = layer(*(outputs[source] for source in layer.sources))
        elif isinstance(layer, Shortcut):
            x = layer(x, outputs[layer.sources[-1]])
        else:
            x = layer(x)
        if index in kept:
            outputs[index] = x
    return found, [outputs[index] for index in taps]


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
        self.eval()
        # oneDNN's and cuDNN's own layout: forward plus backward takes 0.6 to 0.8 of the time on a CPU.
        for layer in self.layers:
            if isinstance(layer, Convolution):
                layer.weight.data = layer.weight.data.contiguous(memory_format=torch.channels_last)

    def forward(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1], H and W multiples of ``stride``; boxes in their pixels."""
        found, _ = run(self.layers, images)
        parts = ([getattr(one, name) for one in found] for name in ("boxes", "objectness", "classes"))
        return DensePredictions(*(torch.cat(part, 1) for part in parts))


class _Builder:
    """Turns sections into modules, following channels and scale so that a wrong cfg is caught here."""

    def __init__(self, channels: int) -> None:
        self._channels = [channels]  # entry i + 1 leaves layer i
        self.scales = [1.0]
        self._parameters = 0

    def add(self, section: Section) -> nn.Module:
        self._next_channels, self._next_scale = self._channels[-1], self.scales[-1]
        module: nn.Module = getattr(self, f"_{section.kind}")(section)
        if not 1 / MAX_SCALE <= self._next_scale <= MAX_SCALE:
            raise section.error(f"scales the image by more than {MAX_SCALE}")
        self._channels.append(self._next_channels)
        self.scales.append(self._next_scale)
        return module

    def _convolutional(self, section: Section) -> nn.Module:
        size, stride = section.integer("size", 1, 1, 31), section.integer("stride", 1, 1, 32)
        padding = size // 2 if section.integer("pad", 0, 0, 1) else section.integer("padding", 0, 0, 31)
        filters = section.integer("filters", None, 1)
        normalized = bool(section.integer("batch_normalize", 0, 0, 1))
        activation = section.choice("activation", tuple(ACTIVATIONS), "linear")
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
        return Shortcut(sources, section.choice("activation", tuple(ACTIVATIONS), "linear"))

    def _upsample(self, section: Section) -> nn.Module:
        stride = section.integer("stride", 2, 1, 32)
        self._next_scale = self.scales[-1] / stride
        return nn.Upsample(scale_factor=stride, mode="nearest")

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
