"""Graphs in the forms of operators that onnx2torch knows: those of operator set 17, and two more operators."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from torch import Tensor, nn
from torch.nn import functional

from .foreign import extra

if TYPE_CHECKING:
    from onnx import GraphProto, ModelProto, NodeProto

KNOWN_OPSET = 17
_MODES = {"linear": "bilinear", "cubic": "bicubic"}  # newer names of older modes


class GridSample(nn.Module):
    """Values (B, C, H, W) at places (B, h, w, 2) in [-1, 1], which deformable attention reads; (B, C, h, w)."""

    def __init__(self, mode: str, padding_mode: str, align_corners: bool) -> None:
        super().__init__()
        self.options: dict[str, Any] = {
            "mode": _MODES.get(mode, mode), "padding_mode": padding_mode, "align_corners": align_corners
        }  # fmt: skip

    def forward(self, values: Tensor, places: Tensor) -> Tensor:
        return functional.grid_sample(values, places, **self.options)


class Gelu(nn.Module):
    """ONNX has it since operator set 20."""

    def __init__(self, approximate: str) -> None:
        super().__init__()
        self.approximate = approximate

    def forward(self, x: Tensor) -> Tensor:
        return functional.gelu(x, approximate=self.approximate)


def convertible(model: ModelProto) -> ModelProto:
    """A copy of the model for onnx2torch, as if exported with operator set 17 where it has a newer one.

    What changed since are number types, and whether a reduction's axes are an input; whatever else did shows when the
    converted graph is compared with onnxruntime.
    """
    _register()
    copy = extra("onnx").shape_inference.infer_shapes(model)
    for opset in copy.opset_import:
        if opset.domain in ("", "ai.onnx") and opset.version > KNOWN_OPSET:
            opset.version = KNOWN_OPSET
    _lower(copy.graph)
    return copy


def folded(model: ModelProto, shape: Sequence[int | None]) -> ModelProto:
    """The model for inputs of ``shape`` alone, with all that follows from it computed; onnxruntime writes it.

    onnx2torch takes sizes that a graph computes as it runs in few places: DETR's exports are full of others.
    """
    onnxruntime, fixed = extra("onnxruntime"), type(model)()
    fixed.CopyFrom(model)
    for axis, side in zip(fixed.graph.input[0].type.tensor_type.shape.dim, shape, strict=True):
        if side is not None:
            axis.dim_value = side
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC  # standard operators only
    with TemporaryDirectory(prefix="rauca-") as folder:
        options.optimized_model_filepath = str(Path(folder) / "folded.onnx")
        onnxruntime.InferenceSession(fixed.SerializeToString(), options, providers=["CPUExecutionProvider"])
        found: ModelProto = extra("onnx").load_model(options.optimized_model_filepath)
    return found


def _lower(graph: GraphProto) -> None:
    constants = {tensor.name: tensor for tensor in graph.initializer}
    for node in graph.node:
        if node.op_type == "Constant" and node.attribute[0].name == "value":
            constants[node.output[0]] = node.attribute[0].t
    for node in graph.node:
        while node.input and not node.input[-1]:  # left out; onnx2torch looks for a value of that name
            node.input.pop()
        if node.op_type == "Split":
            _drop(node, "num_outputs")
        if node.op_type.startswith("Reduce") and node.op_type != "ReduceSum" and len(node.input) == 2:
            axes = node.input.pop()
            if axes in constants:
                numpy_helper = extra("onnx").numpy_helper
                node.attribute.append(
                    extra("onnx").helper.make_attribute("axes", numpy_helper.to_array(constants[axes]).tolist())
                )
            _drop(node, "noop_with_empty_axes")


def _drop(node: NodeProto, name: str) -> None:
    for index, attribute in enumerate(node.attribute):
        if attribute.name == name:
            del node.attribute[index]
            return


@cache
def _register() -> None:
    """Tell onnx2torch, once in a process, of the operators that it lacks."""
    registry, common = (extra(f"onnx2torch.{name}") for name in ("node_converters.registry", "utils.common"))

    def known(version: int, kind: str, module: Any) -> None:
        def convert(node: Any, graph: Any) -> Any:
            made = module(node.attributes)
            return common.OperationConverterResult(made, common.onnx_mapping_from_node(node))

        registry.add_converter(operation_type=kind, version=version)(convert)

    def grid_sample(attributes: Any) -> nn.Module:
        mode, padding = attributes.get("mode", "linear"), attributes.get("padding_mode", "zeros")
        return GridSample(mode, padding, bool(attributes.get("align_corners", 0)))

    known(16, "GridSample", grid_sample)
    known(KNOWN_OPSET, "Gelu", lambda attributes: Gelu(attributes.get("approximate", "none")))
    for kind in ("GreaterOrEqual", "LessOrEqual"):  # since 16 for one more number type
        registry.add_converter(operation_type=kind, version=16)(registry.get_converter(kind, 12))
