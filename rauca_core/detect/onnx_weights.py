"""Weights of an ONNX graph that can learn in torch and be written back into the very file they came from.

These are weights and biases of convolutions that the file holds as 32-bit numbers. All else, such as the decoding of
boxes, stays as it was exported: what is written has the same nodes, inputs and outputs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from .foreign import extra
from .onnx_fusion import Pointwise
from .onnx_graph import OnnxGraph

NOTE = "rauca"  # key of the metadata that says that weights were changed


@dataclass(frozen=True, eq=False)
class LearntTensor:
    """A tensor of the file.

    Attributes:
        value: as in the file, float32.
        places: the parameters of the converted graph that hold it; several where layers share it.
    """

    value: NDArray[np.float32]
    places: tuple[str, ...]


def learnt_tensors(graph: OnnxGraph, network: nn.Module) -> dict[str, LearntTensor]:
    """The tensors of a graph that can learn, by their names in the file.

    A convolution of the converted graph belongs to the node that has the same numbers. One whose weights are whole
    numbers is a formula, such as YOLOv8's mean over distances, and never learns; nor does what the conversion changed,
    or a tensor that something beside a convolution reads.

    Args:
        network: the graph converted by :func:`onnx_graph.to_torch`, fused or not.
    """
    stored, waiting = _stored(graph), _convolutions(graph)
    places: dict[str, list[str]] = defaultdict(list)
    for name, layer in network.named_modules():
        if not isinstance(layer, nn.Conv2d | Pointwise):
            continue
        same = waiting.get(_numbers(layer.weight, layer.bias), [])
        if not same:
            continue
        weight, bias = same.pop(0)
        places[weight].append(f"{name}.weight")
        if bias:
            places[bias].append(f"{name}.bias")
    formulas = {name for name, value in stored.items() if value.ndim > 1 and bool((value == value.round()).all())}
    barred = formulas | _read_elsewhere(graph) | {name for pairs in waiting.values() for pair in pairs for name in pair}
    return {name: LearntTensor(stored[name], tuple(found)) for name, found in places.items() if name not in barred}


def with_tensors(graph: OnnxGraph, values: Mapping[str, Tensor], note: str) -> bytes:
    """The file of a graph with other numbers in some of its tensors, and a note about it in its metadata.

    Tensors that lay in files beside it are inside. Names and order of inputs, outputs and nodes stay.

    Args:
        values: by name; of the same shapes.
    """
    model, helper = type(graph.model)(), extra("onnx").numpy_helper
    model.CopyFrom(graph.model)
    for tensor in model.graph.initializer:
        if tensor.name in values:
            array = values[tensor.name].detach().cpu().float().contiguous().numpy()
            assert list(array.shape) == list(tensor.dims), tensor.name
            tensor.CopyFrom(helper.from_array(array, tensor.name))
    kept = {entry.key: entry.value for entry in model.metadata_props} | {NOTE: note}
    extra("onnx").helper.set_model_props(model, kept)
    extra("onnx").checker.check_model(model)
    written: bytes = model.SerializeToString()
    return written


def _stored(graph: OnnxGraph) -> dict[str, NDArray[np.float32]]:
    """The 32-bit tensors of the file by name."""
    onnx = extra("onnx")
    floats = (one for one in graph.model.graph.initializer if one.data_type == onnx.TensorProto.FLOAT)
    return {one.name: onnx.numpy_helper.to_array(one) for one in floats}


def _convolutions(graph: OnnxGraph) -> dict[bytes, list[tuple[str, str]]]:
    """Names of weight and bias ("" without one) of the convolutions, by their numbers, in the file's order."""
    stored, root = _stored(graph), _roots(graph)
    found: dict[bytes, list[tuple[str, str]]] = defaultdict(list)
    for node in graph.model.graph.node:
        if node.op_type != "Conv":
            continue
        names = [root.get(name, name) for name in node.input[1:] if name]
        if all(name in stored for name in names):
            weight, bias = (*names, "")[:2]
            found[_numbers(stored[weight], stored.get(bias))].append((weight, bias))
    return found


def _read_elsewhere(graph: OnnxGraph) -> set[str]:
    """What a node beside a convolution reads, or a convolution as its image."""
    root, found = _roots(graph), set[str]()
    for node in graph.model.graph.node:
        if node.op_type != "Identity":
            found |= {root.get(name, name) for name in (node.input[:1] if node.op_type == "Conv" else node.input)}
    return found | {root.get(one.name, one.name) for one in graph.model.graph.output}


def _roots(graph: OnnxGraph) -> dict[str, str]:
    """What a name stands for: torch's exporter writes equal tensors once, and gives them on by identities."""
    root: dict[str, str] = {}
    for node in graph.model.graph.node:
        if node.op_type == "Identity":
            root[node.output[0]] = root.get(node.input[0], node.input[0])
    return root


def _numbers(weight: Tensor | NDArray[np.float32], bias: Tensor | NDArray[np.float32] | None) -> bytes:
    """What a convolution is known by, in the file and in torch.

    Its shape is left out: a convolution of one pixel has two axes in a fused graph and four in the file.
    """
    given = (one for one in (weight, bias) if one is not None)
    arrays = (one.detach().cpu().numpy() if isinstance(one, Tensor) else one for one in given)
    return b"|".join(array.tobytes() for array in arrays)
