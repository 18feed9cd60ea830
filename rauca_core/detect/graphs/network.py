"""A network once its file format is behind us: layers as data, simplified, then run as a torch module.

Values between layers are named; a layer's value bears the layer's name. Images are (B, C, H, W), rows (B, N, K).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

Array = NDArray[np.float64]  # float64 until batch norms are folded: small variances make scales that cost digits
ActivationKind = Literal["relu", "relu6", "sigmoid", "hard_swish"]

IMAGE = ":image"  # the network's input, (B, 3, size, size); no format allows this as a name


@dataclass(frozen=True)
class Layer:
    """One value: its name and the names of the values it is computed from."""

    name: str
    inputs: tuple[str, ...]


@dataclass(frozen=True)
class Convolution(Layer):
    """Cross-correlation with zero padding.

    Attributes:
        kernel: (out, in / groups, height, width).
        bias: (out,).
        padding: (rows, columns) on both sides; None for TensorFlow's SAME, which may pad one more after than before.
    """

    kernel: Array
    bias: Array
    stride: tuple[int, int]
    dilation: tuple[int, int]
    padding: tuple[int, int] | None
    groups: int


@dataclass(frozen=True)
class Affine(Layer):
    """value * scale + shift; both (C,) along the channels, or scalars ()."""

    scale: Array
    shift: Array


@dataclass(frozen=True)
class Activation(Layer):
    kind: ActivationKind


@dataclass(frozen=True)
class Sum(Layer):
    """Of two values of one shape."""


@dataclass(frozen=True)
class Product(Layer):
    """Of two images with the same channels; one may be 1 x 1."""


@dataclass(frozen=True)
class Mean(Layer):
    """Over rows and columns: (B, C, 1, 1)."""


@dataclass(frozen=True)
class Permute(Layer):
    order: tuple[int, ...]


@dataclass(frozen=True)
class Reshape(Layer):
    """To ``shape``; 0 keeps the value's own extent there, -1 takes what is left."""

    shape: tuple[int, ...]


@dataclass(frozen=True)
class Concat(Layer):
    axis: int


@dataclass(frozen=True)
class Softmax(Layer):
    axis: int


def simplify(layers: Iterable[Layer], outputs: Iterable[str]) -> list[Layer]:
    """Layers, in an order of computation, that give the same ``outputs``; values in between may disappear."""
    kept = {layer.name: layer for layer in layers}
    outputs = tuple(outputs)
    _drop_identities(kept, outputs)
    _join_hard_swish(kept, outputs)
    _fold_affine(kept, outputs)
    return list(kept.values())


def _uses(layers: dict[str, Layer], outputs: tuple[str, ...]) -> Counter[str]:
    uses = Counter(name for layer in layers.values() for name in layer.inputs)
    uses.update(outputs)
    return uses


def _drop_identities(layers: dict[str, Layer], outputs: tuple[str, ...]) -> None:
    """Graphs divide all scores by a temperature of 1."""
    renamed: dict[str, str] = {}
    for name, layer in list(layers.items()):
        inputs = tuple(renamed.get(source, source) for source in layer.inputs)
        if _is_affine(layer, 1.0, 0.0) and name not in outputs:
            renamed[name] = inputs[0]
            del layers[name]
        elif inputs != layer.inputs:
            layers[name] = replace(layer, inputs=inputs)


def _fold_affine(layers: dict[str, Layer], outputs: tuple[str, ...]) -> None:
    """An affine map after a convolution, or after another affine map, that nobody else reads becomes part of it."""
    uses = _uses(layers, outputs)
    for name, layer in list(layers.items()):
        before = layers.get(layer.inputs[0])
        if not isinstance(layer, Affine) or before is None or uses[before.name] > 1:
            continue
        if isinstance(before, Convolution):
            kernel = before.kernel * layer.scale.reshape(-1, 1, 1, 1)
            joined: Layer = replace(before, name=name, kernel=kernel, bias=before.bias * layer.scale + layer.shift)
        elif isinstance(before, Affine):
            joined = replace(
                before, name=name, scale=before.scale * layer.scale, shift=before.shift * layer.scale + layer.shift
            )
        else:
            continue
        layers[name] = joined
        del layers[before.name]


def _join_hard_swish(layers: dict[str, Layer], outputs: tuple[str, ...]) -> None:
    """x * relu6(x + 3) / 6 is spelled out in four nodes; one layer of torch's own is several times faster."""
    uses = _uses(layers, outputs)
    for name, sixth in list(layers.items()):
        chain = _hard_swish_chain(layers, sixth)
        if chain and all(uses[inner] == 1 for inner in chain[1:]):
            layers[name] = Activation(name, chain[:1], "hard_swish")
            for inner in chain[1:]:
                del layers[inner]


def _hard_swish_chain(layers: dict[str, Layer], sixth: Layer) -> tuple[str, ...]:
    """(x, x + 3, relu6, product) when ``sixth`` ends such a chain, else ()."""
    product = layers.get(sixth.inputs[0])
    if not (_is_affine(sixth, 1 / 6, 0.0) and isinstance(product, Product)):
        return ()
    for x, gate in (product.inputs, product.inputs[::-1]):
        relu6 = layers.get(gate)
        if not (isinstance(relu6, Activation) and relu6.kind == "relu6"):
            continue
        three = layers.get(relu6.inputs[0])
        if three is not None and _is_affine(three, 1.0, 3.0) and three.inputs == (x,):
            return x, three.name, relu6.name, product.name
    return ()


def _is_affine(layer: Layer, scale: float, shift: float) -> bool:
    return (
        isinstance(layer, Affine)
        and layer.scale.ndim == 0
        and layer.shift.ndim == 0
        and bool(np.isclose(layer.scale, scale, rtol=1e-6))
        and bool(np.isclose(layer.shift, shift, rtol=1e-6))
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
        case Softmax():
            return nn.Softmax(layer.axis)
        case Permute(order=order):
            return _Function(lambda x: x.permute(order))
        case Reshape(shape=shape):
            return _Function(lambda x: x.reshape([extent or x.shape[axis] for axis, extent in enumerate(shape)]))
        case Concat(axis=axis):
            return _Function(lambda *values: torch.cat(values, axis))
        case Sum():
            return _Function(torch.add)
        case Product():
            return _Function(torch.mul)
        case Mean():
            return _Function(lambda x: x.mean((2, 3), keepdim=True))
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


class _Function(nn.Module):
    """What has no parameters."""

    def __init__(self, function: Callable[..., Tensor]) -> None:
        super().__init__()
        self.function = function

    def forward(self, *values: Tensor) -> Tensor:
        return self.function(*values)
