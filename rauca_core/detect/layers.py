"""Darknet's layers as modules; batch normalization is folded into the convolution when the weights are read.

Each tells by ``shape`` what it would make of an image, and raises :class:`ValueError` where it would fail.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

ACTIVATIONS = ("linear", "leaky", "relu", "mish")
Shape = tuple[int, int, int]  # channels, height, width


def activate(x: Tensor, activation: str) -> Tensor:
    """Apply one of :data:`ACTIVATIONS`, in place where its gradient allows; darknet's leaky slope is 0.1."""
    if activation == "leaky":
        return functional.leaky_relu(x, 0.1, inplace=True)
    if activation == "relu":
        return functional.relu(x, inplace=True)
    if activation == "mish":
        return functional.mish(x)
    return x


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
        return activate(functional.conv2d(x, self.weight, self.bias, self.stride, self.padding), self.activation)

    def shape(self, x: Shape) -> Shape:
        filters, inputs, size, _ = self.weight.shape
        if x[0] != inputs:
            raise ValueError(f"a convolution of {inputs} channels is given {x[0]}")
        return filters, *_windows(x, 2 * self.padding, size, self.stride)


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

    def shape(self, x: Shape) -> Shape:
        return x[0], *_windows(x, self.padding, self.size, self.stride)


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

    def shape(self, *inputs: Shape) -> Shape:
        if len({x[1:] for x in inputs}) != 1:
            raise ValueError(f"layers of different sizes are joined: {_sizes(inputs)}")
        return sum(x[0] // self.groups for x in inputs), *inputs[0][1:]


class Shortcut(nn.Module):
    """Add an earlier output of the same shape to the current one."""

    def __init__(self, sources: list[int], activation: str) -> None:
        super().__init__()
        self.sources = sources
        self.activation = activation

    def forward(self, *inputs: Tensor) -> Tensor:
        return activate(inputs[0] + inputs[1], self.activation)

    def shape(self, *inputs: Shape) -> Shape:
        if inputs[0] != inputs[1]:
            raise ValueError(f"layers of different sizes are added: {_sizes(inputs)}")
        return inputs[0]


class Upsample(nn.Module):
    """(B, C, H, W) -> (B, C, s*H, s*W), nearest neighbor."""

    def __init__(self, stride: int) -> None:
        super().__init__()
        self.stride = stride

    def forward(self, x: Tensor) -> Tensor:
        return functional.interpolate(x, scale_factor=float(self.stride), mode="nearest")

    def shape(self, x: Shape) -> Shape:
        return x[0], x[1] * self.stride, x[2] * self.stride


def _windows(x: Shape, padding: int, size: int, stride: int) -> tuple[int, int]:
    """How many windows of ``size`` fit, down and across; ``padding`` is the total over both sides."""
    if min(x[1:]) + padding < size:
        raise ValueError(f"a window of {size} pixels is wider than the {min(x[1:])} there are and {padding} of padding")
    down, across = ((extent + padding - size) // stride + 1 for extent in x[1:])
    return down, across


def _sizes(shapes: tuple[Shape, ...]) -> str:
    return ", ".join(" x ".join(map(str, shape)) for shape in shapes)
