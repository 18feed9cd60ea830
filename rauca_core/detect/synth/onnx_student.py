"""An ONNX graph whose convolutions learn by :mod:`.student_losses`; the graph as it was says what is to be kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn
from torch.func import functional_call

from ...contract import RaucaError
from ..interface import DensePredictions
from ..onnx_detector import OnnxDetector, in_batches
from ..onnx_graph import OnnxGraph
from ..onnx_weights import learnt_tensors
from .network import Truth
from .student_losses import student_losses


class OnnxStudent(nn.Module):
    """A graph that learns; whatever normalizes or drops out does so as when it infers.

    Attributes:
        names: of the tensors that learn, as in the file.
        tensors: their values, in the same order: all that this module's state holds.
    """

    def __init__(self, detector: OnnxDetector, graph: OnnxGraph) -> None:
        """Begin with the file's weights.

        Args:
            graph: the file that the detector was read from.

        Raises:
            RaucaError: the file holds no convolution's weights as 32-bit numbers.
        """
        super().__init__()
        assert detector.network is not None, "a graph that cannot be differentiated cannot learn"
        learnt = learnt_tensors(graph, detector.network)
        if not learnt:
            raise RaucaError(f"{graph.path}: holds no weights of convolutions as 32-bit numbers; nothing could learn")
        self.names = tuple(learnt)
        values = (torch.from_numpy(one.value.copy()) for one in learnt.values())
        self.tensors = nn.ParameterList([nn.Parameter(_last(value)) for value in values])
        own = dict(detector.network.named_parameters())
        self._places = [[(place, own[place].shape) for place in one.places] for one in learnt.values()]
        self._before = [detector.network]  # in a list: no part of the module, nor of its state
        self._name, self._shape, self._batch = detector.name, detector.shape, detector.torch_batch
        self._layout = detector.layout

    @property
    def backbone(self) -> nn.Module:
        """All of it was trained before."""
        return self

    def train(self, mode: bool = True) -> OnnxStudent:
        """An exported graph has no other mode than the one it infers in."""
        return super().train(False)

    def learnt(self) -> dict[str, Tensor]:
        """The tensors by their names in the file."""
        return dict(zip(self.names, self.tensors, strict=True))

    @torch.no_grad()
    def learn(self, values: Mapping[str, Tensor]) -> None:
        """Take over tensors by name, such as those of a later file of the same graph."""
        for name, tensor in self.learnt().items():
            tensor.copy_(values[name])

    def dense(self, images: Tensor) -> DensePredictions:
        """Predictions in sRGB images (B, 3, H, W) in [0, 1] with the weights that learn; boxes in their pixels."""
        worn = {
            place: tensor.reshape(shape)
            for tensor, places in zip(self.tensors, self._places, strict=True)
            for place, shape in places
        }
        return self._predict(images, worn)

    def losses(self, images: Tensor, truths: Sequence[Truth], plain: Tensor) -> dict[str, Tensor]:
        """Objectness, class and box of the predictions that answer for a vehicle; what was said before elsewhere.

        Args:
            plain: the images with the vehicles in plain paint: what was said before is said of these.
        """
        found = self.dense(images)
        with torch.no_grad():
            before = self._predict(plain, {})
        return student_losses(found, before, truths)

    def _predict(self, images: Tensor, worn: dict[str, Tensor]) -> DensePredictions:
        network = self._before[0].to(images.device)

        def run(fitted: Tensor) -> tuple[Tensor, ...]:
            return in_batches(lambda part: functional_call(network, worn, (part,)), fitted, self._batch)

        return self._layout.predict(self._name, images, self._shape, run)


def _last(value: Tensor) -> Tensor:
    """Kernels with their channels last in memory, as the fused graph reads them."""
    return value.contiguous(memory_format=torch.channels_last) if value.ndim == 4 else value
