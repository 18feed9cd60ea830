"""An ONNX graph in onnxruntime: on the CPU, without gradients."""

from __future__ import annotations

import torch
from torch import Tensor

from ..contract import RaucaError
from .onnx_graph import OnnxGraph, extra, first_line


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

    def __call__(self, images: Tensor) -> Tensor:
        """(B, 3, H, W), as the graph wants them -> its first output, on the images' device; no gradient.

        Raises:
            RaucaError: the graph fails on these.
        """
        fed = {self._graph.input_name: images.detach().float().cpu().numpy()}
        try:
            (found,) = self._session.run([self._graph.output_names[0]], fed)
        except Exception as error:
            raise RaucaError(
                f"{self._graph.path}: does not run on {tuple(images.shape)} ({first_line(error)})"
            ) from error
        return torch.from_numpy(found).to(images.device)
