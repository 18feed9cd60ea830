"""Making a converted graph fast without changing what it computes."""

from __future__ import annotations

import operator
from typing import Any

import torch
from torch import Tensor, fx, nn
from torch.nn import functional


class Pointwise(nn.Module):
    """A convolution of one pixel as the matrix product it is: torch's own takes half as long again on small maps."""

    def __init__(self, layer: nn.Conv2d) -> None:
        super().__init__()
        self.weight = nn.Parameter(layer.weight.detach().flatten(1).clone(), requires_grad=False)
        self.bias = layer.bias

    def forward(self, x: Tensor) -> Tensor:
        return functional.linear(x.permute(0, 2, 3, 1), self.weight, self.bias).permute(0, 3, 1, 2)


class Outputs(nn.Module):
    """A graph as a function of an image batch, whatever its memory layout, with a tuple of outputs."""

    def __init__(self, graph: nn.Module) -> None:
        super().__init__()
        self.graph = graph

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        found = self.graph(images.contiguous(memory_format=torch.channels_last))
        return tuple(found) if isinstance(found, list | tuple) else (found,)


def fuse(module: fx.GraphModule) -> nn.Module:
    """The same graph with fewer and cheaper operations, convolutions in oneDNN's and cuDNN's own layout."""
    _fuse_silu(module)
    _fix_slices(module)
    module.recompile()
    for name, layer in list(module.named_modules()):
        if isinstance(layer, nn.Conv2d):
            layer.weight.data = layer.weight.data.contiguous(memory_format=torch.channels_last)
            if _is_pointwise(layer):
                module.set_submodule(name, Pointwise(layer))
    return Outputs(module)


def _is_pointwise(layer: nn.Conv2d) -> bool:
    plain = layer.kernel_size == layer.stride == (1, 1) and layer.groups == 1
    return plain and layer.padding in ((0, 0), 0, "valid")


def _fuse_silu(module: fx.GraphModule) -> None:
    for node in list(module.graph.nodes):
        if node.op != "call_module" or not isinstance(module.get_submodule(str(node.target)), nn.Sigmoid):
            continue
        source, users = node.args[0], list(node.users)
        if len(users) == 1 and source in users[0].args and _multiplies(module, users[0]):
            with module.graph.inserting_after(users[0]):
                fused = module.graph.call_function(functional.silu, (source,))
            users[0].replace_all_uses_with(fused)
            module.graph.erase_node(users[0])
            module.graph.erase_node(node)


def _multiplies(module: fx.GraphModule, node: fx.Node) -> bool:
    """Whether a node is onnx2torch's product of two values."""
    return (
        node.op == "call_module"
        and getattr(module.get_submodule(str(node.target)), "math_op_function", None) is torch.mul
    )


def _fix_slices(module: fx.GraphModule) -> None:
    """Slices whose bounds are constants need neither look at them on every run nor wait for a GPU to do so."""
    for node in list(module.graph.nodes):
        if node.op != "call_module" or type(module.get_submodule(str(node.target))).__name__ != "OnnxSlice":
            continue
        bounds = _bounds(module, node)
        if bounds is None:
            continue
        slices = {axis: slice(start, end, step) for start, end, axis, step in bounds}
        index = tuple(slices.get(axis, slice(None)) for axis in range(max(slices) + 1))
        with module.graph.inserting_after(node):
            fixed = module.graph.call_function(operator.getitem, (node.args[0], index))
        node.replace_all_uses_with(fixed)
        module.graph.erase_node(node)


def _bounds(module: fx.GraphModule, node: fx.Node) -> list[tuple[int, int, int, int]] | None:
    """Start, end, axis and step of each axis that a slice cuts, if all are constant and none counts backwards."""
    found = [_constant(module, argument) for argument in (*node.args[1:], *node.kwargs.values())]
    values = [value for value in found if value is not None]
    if len(values) != 4 or len(found) != 4 or min(values[2] + values[3]) < 0:
        return None
    return list(zip(*values, strict=True))


def _constant(module: fx.GraphModule, argument: Any) -> list[int] | None:
    """The numbers of an initializer, or of onnx2torch's module for a constant."""
    if not isinstance(argument, fx.Node) or argument.op not in ("get_attr", "call_module"):
        return None
    holder, _, name = str(argument.target).rpartition(".")
    value = getattr(module.get_submodule(holder), name)
    value = getattr(value, "value", None) if isinstance(value, nn.Module) else value
    return value.tolist() if isinstance(value, Tensor) and value.ndim == 1 else None
