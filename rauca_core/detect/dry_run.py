"""A network run on shapes alone, before anything large is made: do its layers fit, and would it fit in memory?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.func import functional_call

from ..contract import RaucaError
from .foreign import first_line

MAX_PARAMETERS = 2**28  # 1 GiB as float32; YOLOv4, the largest of these networks, has 64 million
MAX_VALUES = 2**31  # of all layers together, for one image: YOLOv4 makes 0.2 thousand million at 608 pixels


def dry_run(path: Path, network: nn.Module, size: int) -> Any:
    """What ``network`` makes of one image (1, 3, size, size), as tensors without memory.

    Raises:
        RaucaError: names ``path``: layers whose shapes do not fit together, or that make more than
            :data:`MAX_VALUES` values.
    """
    made = 0

    def count(module: nn.Module, inputs: Any, output: Any) -> None:
        nonlocal made
        made += output.numel() if isinstance(output, Tensor) else 0
        if made > MAX_VALUES:
            raise RaucaError(f"{path}: makes more than {MAX_VALUES} values of one image of {size} pixels; too large")

    tensors = [*network.named_parameters(), *network.named_buffers()]
    shapes = {name: tensor.to("meta") for name, tensor in tensors}
    hooks = [module.register_forward_hook(count) for module in network.modules()]
    try:
        with torch.no_grad():
            return functional_call(network, shapes, (torch.empty(1, 3, size, size, device="meta"),))
    except (RuntimeError, TypeError, ValueError, IndexError) as error:
        raise RaucaError(f"{path}: the layers' shapes do not fit together ({first_line(error)})") from error
    finally:
        for hook in hooks:
            hook.remove()
