"""ONNX files, read with distrust: what a file is, and where its tensors lie, is checked before anything runs."""

from __future__ import annotations

import ast
import hashlib
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.fx import GraphModule

from ..contract import RaucaError
from ..contract.reading import read_limited, require_inside
from .exports import yolo_export
from .foreign import extra, first_line
from .onnx_operators import convertible, folded

if TYPE_CHECKING:
    from onnx import FunctionProto, GraphProto, ModelProto

MAX_FILE_BYTES = 2**31  # protobuf's own limit
MAX_NODES = 50_000  # with each function written out as often as it is called; detectors have hundreds
MAX_LITERAL = 2**16  # characters of a list of class names; LVIS, the longest in use, has 20 000
SIZES = "orig_target_sizes"  # RT-DETR's, D-FINE's and DEIM's own exports scale boxes by it
_LOOPS = {"Loop", "Scan"}


@dataclass(frozen=True)
class OnnxGraph:
    """A graph with one image batch as its input.

    Attributes:
        output_names: in the file's order.
        sizes_name: the input that takes the images' (width, height), of exports of RT-DETR's own; empty without one.
        batch, height, width: of the input; None where the export left them open.
        operators: types of its nodes, those of its functions too.
        metadata: text that the exporter left.
        sha256: of the file and the tensors outside it.
    """

    path: Path
    model: ModelProto
    input_name: str
    output_names: tuple[str, ...]
    sizes_name: str
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
    def image_shape(self) -> tuple[int, int] | None:
        """Ultralytics exports say for which (height, width) they were made."""
        sizes = self._literal("imgsz")
        fits = isinstance(sizes, list) and len(sizes) == 2 and all(type(size) is int for size in sizes)
        return (sizes[0], sizes[1]) if fits else None

    @property
    def half(self) -> bool:
        """Its images are numbers of 16 bits."""
        images = next(value for value in self.model.graph.input if value.name == self.input_name)
        return bool(images.type.tensor_type.elem_type == extra("onnx").TensorProto.FLOAT16)

    @property
    def task(self) -> str:
        """Ultralytics exports say what they are for, ``"detect"`` for one."""
        return self.metadata.get("task", "")

    def _literal(self, key: str) -> Any:
        try:
            text = self.metadata.get(key, "None")
            return ast.literal_eval(text) if len(text) <= MAX_LITERAL else None
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            return None


def read_graph(path: Path) -> OnnxGraph:
    """Read and check an ONNX file.

    Raises:
        RaucaError: not an ONNX file, unknown operators, loops, too many nodes, tensors outside the file's folder,
            inputs other than one image batch; names the file. Or onnx is not installed.
    """
    onnx = extra("onnx")
    data = read_limited(path, MAX_FILE_BYTES, "a detector's graph")
    try:
        model = onnx.load_model_from_string(data)
    except Exception as error:  # protobuf's own error type differs between its implementations
        raise RaucaError(f"{path}: not an ONNX file ({first_line(error)})") from error
    digest = hashlib.sha256(data)
    operators = frozenset(node.op_type for node in _within(model, "NodeProto"))
    _refuse_endless(path, model, operators)
    for outside in _external_files(path, model):
        digest.update(read_limited(outside, MAX_FILE_BYTES, "a detector's tensors"))
    try:
        _load_external(model, path.parent)
        onnx.checker.check_model(model)
    except Exception as error:  # its checks are its own, and those of the C++ and protobuf below it
        raise RaucaError(f"{path}: not a graph that can run ({first_line(error)})") from error
    name, sizes_name, (batch, height, width) = _image_input(path, model.graph)
    return OnnxGraph(
        path,
        model,
        name,
        tuple(output.name for output in model.graph.output),
        sizes_name,
        batch,
        height,
        width,
        operators,
        {entry.key: entry.value for entry in model.metadata_props},
        digest.hexdigest(),
    )


def to_torch(graph: OnnxGraph, shape: Sequence[int | None] | None = None) -> GraphModule:
    """The graph as a differentiable module; its weights take no gradient.

    Args:
        shape: that all inputs will have, where the graph can only be converted for one; None leaves an axis open.

    Raises:
        RaucaError: an operator that onnx2torch does not know. Or it is not installed.
    """
    from .frameworks.torchvision_ops import import_torchvision

    import_torchvision()  # onnx2torch imports it
    onnx2torch = extra("onnx2torch")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a library about itself
            module: GraphModule = onnx2torch.convert(convertible(folded(graph.model, shape) if shape else graph.model))
    except Exception as error:  # every converter has its own
        raise RaucaError(f"{graph.path}: onnx2torch cannot convert this graph ({first_line(error)})") from error
    # Its slices index by a list, of which torch warns at the first image; conversions are compared with onnxruntime.
    warnings.filterwarnings("ignore", "Using a non-tuple sequence for multidimensional indexing", UserWarning)
    module.eval().requires_grad_(False)
    return module


def _external_files(path: Path, model: ModelProto) -> list[Path]:
    """Files that hold tensors of the model: each must lie in its folder."""
    found: dict[Path, None] = {}
    for tensor in _within(model, "TensorProto"):
        for entry in tensor.external_data:
            if entry.key == "location":
                outside = require_inside(path, entry.value)
                if not outside.is_file():
                    raise RaucaError(f"{path}: {entry.value} is missing beside it; it holds tensor {tensor.name!r}")
                found[outside] = None
    return list(found)


def _load_external(model: ModelProto, folder: Path) -> None:
    """Read the tensors that lie outside; onnx itself leaves out sparse ones and those in branches of functions."""
    helper = extra("onnx").external_data_helper
    for tensor in _within(model, "TensorProto"):
        if helper.uses_external_data(tensor):
            helper.load_external_data_for_tensor(tensor, str(folder))
            tensor.ClearField("data_location")  # older onnx leaves these two
            tensor.ClearField("external_data")


def _refuse_endless(path: Path, model: ModelProto, operators: frozenset[str]) -> None:
    """A loop may turn for ever, and no export of a detector without suppression has one.

    Functions that call functions twice double with each: thirty of them unfold to more nodes than any machine holds.
    """
    if looping := sorted(operators & _LOOPS):
        raise RaucaError(
            f"{path}: has an operator {looping[0]}, which may turn for ever; export without non-maximum suppression, "
            f"for Ultralytics: {yolo_export(path)}"
        )
    nodes: dict[tuple[str, str], Counter[tuple[str, str]]] = {}
    for function in model.functions:  # of overloads the most, as runtimes differ in which they take
        key = function.domain, function.name
        nodes[key] = nodes.get(key, Counter()) | _calls(function)
    total, level = 0, _calls(model.graph)
    while level:
        total += level.total()
        if total > MAX_NODES:
            raise RaucaError(
                f"{path}: has more than {MAX_NODES} nodes, functions written out; export a smaller network"
            )
        inner: Counter[tuple[str, str]] = Counter()
        for key in level.keys() & nodes.keys():
            inner.update({called: level[key] * count for called, count in nodes[key].items()})
        level = inner


def _calls(part: GraphProto | FunctionProto) -> Counter[tuple[str, str]]:
    """How many nodes of each domain and type it has, in its branches too."""
    return Counter((node.domain, node.op_type) for node in _within(part, "NodeProto"))


def _within(message: Any, kind: str) -> Iterator[Any]:
    """All messages of a kind, however deep: in branches, functions, their attributes' defaults, sparse tensors."""
    if message.DESCRIPTOR.name == kind:
        yield message
    if message.DESCRIPTOR.name == "TensorProto":
        return  # holds numbers alone, which would be copied
    for field, value in message.ListFields():
        if field.message_type is not None:
            for inner in [value] if hasattr(value, "ListFields") else value:
                yield from _within(inner, kind)


def _image_input(path: Path, graph: GraphProto) -> tuple[str, str, Sequence[int | None]]:
    """The image input's name, that of the sizes if it wants them too, and the images' batch, height and width."""
    constants = {tensor.name for tensor in graph.initializer}
    inputs = [value for value in graph.input if value.name not in constants]
    sizes_name = next((value.name for value in inputs if value.name == SIZES), "")
    images = [value for value in inputs if value.name != sizes_name]
    if len(images) != 1:
        raise RaucaError(f"{path}: has {len(inputs)} inputs, expected one batch of images (B, 3, H, W)")
    sizes = [dim.dim_value or None for dim in images[0].type.tensor_type.shape.dim]
    if len(sizes) != 4:
        raise RaucaError(
            f"{path}: input {images[0].name} has {len(sizes)} axes, expected a batch of images (B, 3, H, W)"
        )
    batch, channels, height, width = sizes
    if channels not in (3, None):
        raise RaucaError(f"{path}: input {images[0].name} has {channels} channels, expected a batch of images with 3")
    return images[0].name, sizes_name, (batch, height, width)


class Session:
    """A graph as a function of one image batch; onnxruntime gets as many threads as torch has when it is made."""

    def __init__(self, graph: OnnxGraph) -> None:
        """Load the graph.

        Raises:
            RaucaError: onnxruntime cannot run it (the message names the operator), or is not installed.
        """
        onnxruntime = extra("onnxruntime")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        options.log_severity_level = 4  # what matters is raised
        self._graph = graph
        try:
            self._session = onnxruntime.InferenceSession(
                graph.model.SerializeToString(), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # its errors have no base of their own
            raise RaucaError(f"{graph.path}: onnxruntime cannot run this graph ({first_line(error)})") from error
        self._type = torch.float16 if graph.half else torch.float32

    def __call__(self, images: Tensor) -> tuple[Tensor, ...]:
        """(B, 3, H, W), as the graph wants them -> its outputs, on the images' device; no gradient.

        Raises:
            RaucaError: the graph fails on these.
        """
        fed = {self._graph.input_name: images.detach().to(self._type).cpu().numpy()}
        if self._graph.sizes_name:
            fed[self._graph.sizes_name] = torch.tensor([images.shape[:1:-1]] * len(images)).numpy()
        try:
            found = self._session.run(list(self._graph.output_names), fed)
        except Exception as error:
            raise RaucaError(
                f"{self._graph.path}: does not run on {tuple(images.shape)} ({first_line(error)})"
            ) from error
        return tuple(torch.from_numpy(one).to(images.device) for one in found)
