"""A network once its file format is behind us: a small graph of torch modules, simplified.

Images are (B, C, H, W), rows (B, N, K). Weights are float64 until batch norms are folded: small variances make scales
that cost digits.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, fx, nn
from torch.func import functional_call
from torch.nn import functional

from ...contract import RaucaError
from ..dry_run import MAX_VALUES
from ..foreign import first_line

Array = NDArray[np.float64]


class Convolution(nn.Module):
    """Cross-correlation with zero padding.

    Args:
        weight: (out, in / groups, height, width).
        bias: (out,).
        padding: (rows, columns) on both sides; None for TensorFlow's SAME, which may pad one more after than before.
    """

    def __init__(
        self,
        weight: Array,
        bias: Array,
        stride: tuple[int, int],
        dilation: tuple[int, int],
        padding: tuple[int, int] | None,
        groups: int,
    ) -> None:
        super().__init__()
        self.weight, self.bias = _parameter(weight), _parameter(bias)
        self.stride, self.dilation, self.padding, self.groups = stride, dilation, padding, groups

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


class Affine(nn.Module):
    """value * scale + shift; both (C,) along the channels, or scalars ()."""

    def __init__(self, scale: Any, shift: Any) -> None:
        super().__init__()
        shape = (-1, 1, 1) if np.ndim(scale) or np.ndim(shift) else ()
        self.scale, self.shift = (_parameter(np.reshape(v, shape if np.ndim(v) else ())) for v in (scale, shift))

    def forward(self, x: Tensor) -> Tensor:
        return torch.addcmul(self.shift, x, self.scale)

    def does(self, scale: float, shift: float) -> bool:
        """Whether it is this map of scalars, but for rounding to float32."""
        found = (self.scale, self.shift)
        return all(value.ndim == 0 for value in found) and np.allclose(found, (scale, shift), rtol=1e-6)


class Activation(nn.Module):
    """One of :data:`ACTIVATIONS`.

    Attributes:
        inplace: its input is read by nobody else, and may be overwritten.
    """

    def __init__(self, kind: str) -> None:
        super().__init__()
        self.kind, self.inplace = kind, False

    def forward(self, x: Tensor) -> Tensor:
        return ACTIVATIONS[self.kind](x, self.inplace)


ACTIVATIONS: dict[str, Callable[[Tensor, bool], Tensor]] = {
    "Relu": functional.relu,
    "Relu6": lambda x, inplace: functional.hardtanh(x, 0.0, 6.0, inplace=inplace),
    "Sigmoid": lambda x, inplace: x.sigmoid(),
    # its backward pass needs the input, relu's only the output
    "HardSwish": lambda x, inplace: functional.hardswish(x, inplace=inplace and not x.requires_grad),
}


def reshape(x: Tensor, shape: Sequence[int]) -> Tensor:
    """To ``shape``; 0 keeps the value's own extent there, -1 takes what is left."""
    return x.reshape([extent or x.shape[axis] for axis, extent in enumerate(shape)])


def _parameter(values: Array) -> nn.Parameter:
    return nn.Parameter(torch.tensor(values, dtype=torch.float64), requires_grad=False)


class Builder:
    """Collects layers in an order of computation, and runs each on shapes alone as it comes.

    Attributes:
        image: the network's input, sRGB (B, 3, size, size) in [0, 1].
    """

    def __init__(self, path: Path, size: int) -> None:
        self.path, self.size = path, size
        self._graph, self._layers, self._made = fx.Graph(), nn.ModuleList(), 0
        self.image = self._graph.placeholder("images")
        self.image.meta["value"] = torch.empty(1, 3, size, size, device="meta")

    def add(self, layer: nn.Module | Callable[..., Tensor], *inputs: Any, **options: Any) -> fx.Node:
        """The value of a module or function.

        Raises:
            ValueError: its inputs do not fit it.
            RaucaError: the network grows too large.
        """
        known = fx.node.map_arg(inputs, lambda node: node.meta["value"])
        try:
            if isinstance(layer, nn.Module):
                shapes = {name: value.to("meta") for name, value in layer.named_parameters()}
                made = functional_call(layer, shapes, tuple(value.double() for value in known))
            else:
                made = layer(*known, **options)
        except (RuntimeError, TypeError, IndexError) as error:
            raise ValueError(first_line(error)) from error
        self._made += made.numel()
        if self._made > MAX_VALUES:
            raise RaucaError(f"{self.path}: makes more than {MAX_VALUES} values of one image; too large")
        if isinstance(layer, nn.Module):
            self._layers.append(layer)
            node = self._graph.call_module(f"layers.{len(self._layers) - 1}", inputs)
        else:
            node = self._graph.call_function(layer, inputs, options)
        node.meta["value"] = made
        return node

    def finish(self, boxes: fx.Node, scores: fx.Node) -> fx.GraphModule:
        """The network that makes these two; differentiable with respect to the image, weights take no gradient.

        Weights lie channels-last: the heads' permutation to rows is then free, and depthwise convolutions are fastest.
        """
        self._graph.output((boxes, scores))
        root = nn.Module()
        root.layers = self._layers
        network = fx.GraphModule(root, self._graph)
        network.graph.eliminate_dead_code()
        _drop_identities(network)
        _join_hard_swish(network)
        _fold_affine(network)
        for node in network.graph.nodes:
            layer = _layer(node)
            if isinstance(layer, Activation):
                layer.inplace = isinstance(_layer(node.args[0]), Convolution) and len(node.args[0].users) == 1
        network.float()
        for layer in network.modules():
            if isinstance(layer, Convolution):
                layer.weight.data = layer.weight.data.contiguous(memory_format=torch.channels_last)
        network.delete_all_unused_submodules()
        network.recompile()
        return network.eval()


def _layer(node: Any) -> Any:
    """The module or function behind a value."""
    if node.op != "call_module":
        return node.target
    return node.graph.owning_module.get_submodule(node.target)


def _drop_identities(network: fx.GraphModule) -> None:
    """Graphs divide all scores by a temperature of 1."""
    for node in network.graph.nodes:
        layer = _layer(node)
        if isinstance(layer, Affine) and layer.does(1.0, 0.0):
            node.replace_all_uses_with(node.args[0])
            network.graph.erase_node(node)


def _fold_affine(network: fx.GraphModule) -> None:
    """An affine map after a convolution, or after another affine map, that nobody else reads becomes part of it."""
    for node in network.graph.nodes:
        layer = _layer(node)
        source: Any = node.args[0] if node.args else None
        if not isinstance(layer, Affine) or len(source.users) > 1:
            continue
        before = _layer(source)
        if isinstance(before, Convolution):
            before.weight.data = before.weight * layer.scale.reshape(-1, 1, 1, 1)
            before.bias.data = before.bias * layer.scale.flatten() + layer.shift.flatten()
        elif isinstance(before, Affine):
            before.scale.data = before.scale * layer.scale
            before.shift.data = before.shift * layer.scale + layer.shift
        else:
            continue
        node.replace_all_uses_with(source)
        network.graph.erase_node(node)


def _join_hard_swish(network: fx.GraphModule) -> None:
    """x * relu6(x + 3) / 6 is spelled out in four nodes; one layer of torch's own is several times faster."""
    for node in network.graph.nodes:
        sixth = _layer(node)
        product: Any = node.args[0] if node.args else None
        if not isinstance(sixth, Affine) or not sixth.does(1 / 6, 0.0) or product.target is not operator.mul:
            continue
        for x, gate in (product.args, product.args[::-1]):
            inner = _layer(gate)
            if isinstance(inner, Activation) and inner.kind == "Relu6":
                three = _layer(gate.args[0])
                plain = isinstance(three, Affine) and three.does(1.0, 3.0) and gate.args[0].args == (x,)
                if plain and all(len(one.users) == 1 for one in (product, gate, gate.args[0])):
                    network.set_submodule(node.target, Activation("HardSwish"))
                    node.args = (x,)
                    break
    network.graph.eliminate_dead_code()
