"""ONNX files, read with distrust: what a file is, and where its tensors lie, is checked before anything runs."""

from __future__ import annotations

import ast
import hashlib
import importlib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch.fx import GraphModule

from ..contract import RaucaError
from ..contract.reading import read_limited

if TYPE_CHECKING:
    from onnx import GraphProto, ModelProto, TensorProto

MAX_FILE_BYTES = 2**31  # protobuf's own limit
MAX_LITERAL = 2**16  # characters of a list of class names; LVIS, the longest in use, has 20 000
_LOOPS = {"Loop", "Scan"}


@dataclass(frozen=True)
class OnnxGraph:
    """A graph with one image batch as its input.

    Attributes:
        batch, height, width: of the input; None where the export left them open.
        operators: types of its nodes.
        metadata: text that the exporter left.
        sha256: of the file and the tensors outside it.
    """

    path: Path
    model: ModelProto
    input_name: str
    output_names: tuple[str, ...]
    batch: int | None
    height: int | None
    width: int | None
    operators: frozenset[str]
    metadata: dict[str, str]
    sha256: str

    @property
    def class_names(self) -> tuple[str, ...] | None:
        """Ultralytics exports hold theirs, as the text of a dict or list."""
        names = self._literal("names")
        values = list(names.values()) if isinstance(names, dict) else names
        if not isinstance(values, list) or not values or not all(isinstance(value, str) for value in values):
            return None
        return tuple(values)

    @property
    def image_size(self) -> int | None:
        """Ultralytics exports say for which size they were made."""
        sizes = self._literal("imgsz")
        return max(sizes) if isinstance(sizes, list) and sizes and all(type(s) is int for s in sizes) else None

    def _literal(self, key: str) -> Any:
        try:
            text = self.metadata.get(key, "None")
            return ast.literal_eval(text) if len(text) <= MAX_LITERAL else None
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            return None


def extra(module: str) -> Any:
    """Import a package of the extra ``detectors``; raises :class:`RaucaError` that says how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise RaucaError(f"{module} is not installed; get it with `pip install 'rauca[detectors]'`") from error


def read_graph(path: Path) -> OnnxGraph:
    """Read and check an ONNX file.

    Raises:
        RaucaError: not an ONNX file, unknown operators, tensors outside the file's folder, inputs other than one image
            batch; names the file. Or onnx is not installed.
    """
    onnx = extra("onnx")
    data = read_limited(path, MAX_FILE_BYTES, "a detector's graph")
    try:
        model = onnx.load_model_from_string(data)
    except Exception as error:  # protobuf's own error type differs between its implementations
        raise RaucaError(f"{path}: not an ONNX file ({first_line(error)})") from error
    digest = hashlib.sha256(data)
    _refuse_loops(path, model.graph)
    for outside in _external_files(path, model):
        digest.update(read_limited(outside, MAX_FILE_BYTES, "a detector's tensors"))
    try:
        onnx.external_data_helper.load_external_data_for_model(model, str(path.parent))
        onnx.checker.check_model(model)
    except Exception as error:  # its checks are its own, and those of the C++ and protobuf below it
        raise RaucaError(f"{path}: not a graph that can run ({first_line(error)})") from error
    name, (batch, channels, height, width) = _image_input(path, model.graph)
    if channels not in (3, None):
        raise RaucaError(f"{path}: input {name} has {channels} channels, expected a batch of images with 3")
    return OnnxGraph(
        path,
        model,
        name,
        tuple(output.name for output in model.graph.output),
        batch,
        height,
        width,
        frozenset(node.op_type for node in model.graph.node),
        {entry.key: entry.value for entry in model.metadata_props},
        digest.hexdigest(),
    )


def to_torch(graph: OnnxGraph) -> GraphModule:
    """The graph as a differentiable module; its weights take no gradient.

    Raises:
        RaucaError: an operator that onnx2torch does not know. Or it is not installed.
    """
    from .frameworks import import_torchvision

    import_torchvision()  # onnx2torch imports it
    onnx2torch = extra("onnx2torch")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a library about itself
            module: GraphModule = onnx2torch.convert(graph.model)
    except Exception as error:  # every converter has its own
        raise RaucaError(f"{graph.path}: onnx2torch cannot convert this graph ({first_line(error)})") from error
    module.eval().requires_grad_(False)
    return module


def _external_files(path: Path, model: ModelProto) -> list[Path]:
    """Files that hold tensors of the model: each must lie in its folder."""
    folder = path.resolve().parent
    found: dict[Path, None] = {}
    for tensor in _tensors(model.graph):
        for entry in tensor.external_data:
            if entry.key != "location":
                continue
            outside = (folder / entry.value).resolve()
            if not outside.is_relative_to(folder):
                raise RaucaError(
                    f"{path}: its tensor {tensor.name!r} lies outside its folder, at {entry.value!r}; refused"
                )
            if not outside.is_file():
                raise RaucaError(f"{path}: {entry.value} is missing beside it; it holds tensor {tensor.name!r}")
            found[outside] = None
    return list(found)


def _refuse_loops(path: Path, graph: GraphProto) -> None:
    """A loop may turn for ever, and no export of a detector without suppression has one."""
    looping = sorted({node.op_type for node in graph.node} & _LOOPS)
    if looping:
        raise RaucaError(f"{path}: has an operator {looping[0]}; export without non-maximum suppression")
    for node in graph.node:
        for attribute in node.attribute:
            for inner in (attribute.g, *attribute.graphs):
                if inner.node:
                    _refuse_loops(path, inner)


def _tensors(graph: GraphProto) -> Iterator[TensorProto]:
    yield from graph.initializer
    for sparse in graph.sparse_initializer:
        yield from (sparse.values, sparse.indices)
    for node in graph.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors)
            for inner in (attribute.g, *attribute.graphs):
                if inner.node:
                    yield from _tensors(inner)


def _image_input(path: Path, graph: GraphProto) -> tuple[str, Sequence[int | None]]:
    constants = {tensor.name for tensor in graph.initializer}
    inputs = [value for value in graph.input if value.name not in constants]
    if len(inputs) != 1:
        raise RaucaError(f"{path}: has {len(inputs)} inputs, expected one batch of images (B, 3, H, W)")
    sizes = [dim.dim_value or None for dim in inputs[0].type.tensor_type.shape.dim]
    if len(sizes) != 4:
        raise RaucaError(
            f"{path}: input {inputs[0].name} has {len(sizes)} axes, expected a batch of images (B, 3, H, W)"
        )
    return inputs[0].name, sizes


def first_line(error: Exception) -> str:
    """Of foreign libraries' messages, which may run over pages."""
    lines = str(error).strip().splitlines()
    return (lines[0] if lines else type(error).__name__)[:200]
