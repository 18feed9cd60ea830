"""Layers as a torch module."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from .layers import (
    IMAGE,
    Activation,
    ActivationKind,
    Affine,
    Array,
    Concat,
    Convolution,
    Layer,
    Mean,
    Permute,
    Product,
    Reshape,
    Softmax,
    Sum,
)


class LayerNetwork(nn.Module):
    """Runs layers in their order; differentiable with respect to the image, weights take no gradient.

    Images travel channels-last: the heads' permutation to rows is then free, and depthwise convolutions are fastest.
    """

    def __init__(self, layers: Sequence[Layer], outputs: Sequence[str]) -> None:
        """Take layers in an order of computation; ``outputs`` are the values that :meth:`forward` returns."""
        super().__init__()
        self.outputs = tuple(outputs)
        readers = [name for layer in layers for name in layer.inputs] + list(outputs)
        convolved = {layer.name for layer in layers if isinstance(layer, Convolution)}
        last_use = {name: step for step, layer in enumerate(layers) for name in layer.inputs}
        self.steps = nn.ModuleList()
        self._plan: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = []
        for step, layer in enumerate(layers):
            alone = layer.inputs[0] in convolved and readers.count(layer.inputs[0]) == 1
            self.steps.append(_module(layer, overwrite=alone))
            done = tuple(name for name in set(layer.inputs) if last_use[name] == step and name not in self.outputs)
            self._plan.append((layer.name, layer.inputs, done))
        self.requires_grad_(False)

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        """(B, 3, H, W) normalized images -> the outputs, in their order."""
        values = {IMAGE: images.contiguous(memory_format=torch.channels_last)}
        for module, (name, inputs, done) in zip(self.steps, self._plan, strict=True):
            values[name] = module(*[values[source] for source in inputs])
            for source in done:
                del values[source]
        return tuple(values[name] for name in self.outputs)


def _module(layer: Layer, overwrite: bool) -> nn.Module:
    match layer:
        case Convolution():
            return _Convolution(layer)
        case Affine():
            return _Affine(layer)
        case Activation():
            return _Activation(layer.kind, overwrite)
        case Permute():
            return _Permute(layer.order)
        case Reshape():
            return _Reshape(layer.shape)
        case Concat():
            return _Concat(layer.axis)
        case Softmax():
            return nn.Softmax(layer.axis)
        case Sum() | Product() | Mean():
            return _SIMPLE[type(layer)]()
    raise TypeError(f"no module for {type(layer).__name__}")


def _parameter(values: Array) -> nn.Parameter:
    return nn.Parameter(torch.tensor(values, dtype=torch.float32), requires_grad=False)


class _Convolution(nn.Module):
    def __init__(self, layer: Convolution) -> None:
        super().__init__()
        self.weight = nn.Parameter(_parameter(layer.kernel).contiguous(memory_format=torch.channels_last), False)
        self.bias = _parameter(layer.bias)
        self.stride, self.dilation, self.padding, self.groups = (
            layer.stride,
            layer.dilation,
            layer.padding,
            layer.groups,
        )

    def forward(self, x: Tensor) -> Tensor:
        padding = self.padding
        if padding is None:
            (top, bottom), (left, right) = (self._same(x, axis) for axis in (0, 1))
            padding = (top, left)
            if (top, left) != (bottom, right):
                x, padding = functional.pad(x, (left, right, top, bottom)), (0, 0)
        return functional.conv2d(x, self.weight, self.bias, self.stride, padding, self.dilation, self.groups)

    def _same(self, x: Tensor, axis: int) -> tuple[int, int]:
        """(before, after): as much as makes ceil(extent / stride) outputs, the odd one after."""
        extent, stride = x.shape[2 + axis], self.stride[axis]
        reach = (self.weight.shape[2 + axis] - 1) * self.dilation[axis] + 1
        total = max((-(-extent // stride) - 1) * stride + reach - extent, 0)
        return total // 2, total - total // 2


class _Affine(nn.Module):
    def __init__(self, layer: Affine) -> None:
        super().__init__()
        shape = (-1, 1, 1) if layer.scale.ndim or layer.shift.ndim else ()
        self.scale, self.shift = (_parameter(v.reshape(shape if v.ndim else ())) for v in (layer.scale, layer.shift))

    def forward(self, x: Tensor) -> Tensor:
        return torch.addcmul(self.shift, x, self.scale)


class _Activation(nn.Module):
    def __init__(self, kind: ActivationKind, overwrite: bool) -> None:
        super().__init__()
        self.kind, self.overwrite = kind, overwrite

    def forward(self, x: Tensor) -> Tensor:
        match self.kind:
            case "relu":
                return functional.relu(x, inplace=self.overwrite)
            case "relu6":
                return functional.hardtanh(x, 0.0, 6.0, inplace=self.overwrite)
            case "hard_swish":  # its backward pass needs the input, relu's only the output
                return functional.hardswish(x, inplace=self.overwrite and not x.requires_grad)
            case "sigmoid":
                return x.sigmoid()


class _Sum(nn.Module):
    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        return a + b


class _Product(nn.Module):
    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        return a * b


class _Mean(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return x.mean((2, 3), keepdim=True)


class _Permute(nn.Module):
    def __init__(self, order: tuple[int, ...]) -> None:
        super().__init__()
        self.order = order

    def forward(self, x: Tensor) -> Tensor:
        return x.permute(self.order)


class _Reshape(nn.Module):
    def __init__(self, shape: tuple[int, ...]) -> None:
        super().__init__()
        self.shape = shape

    def forward(self, x: Tensor) -> Tensor:
        return x.reshape([x.shape[axis] if extent == 0 else extent for axis, extent in enumerate(self.shape)])


class _Concat(nn.Module):
    def __init__(self, axis: int) -> None:
        super().__init__()
        self.axis = axis

    def forward(self, *values: Tensor) -> Tensor:
        return torch.cat(values, self.axis)


_SIMPLE: dict[type[Layer], type[nn.Module]] = {Sum: _Sum, Product: _Product, Mean: _Mean}
