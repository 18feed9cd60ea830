"""Several processes on one job, as ``torchrun`` starts them; without it, one process and nothing to do."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import nn

from .devices import find_device

T = TypeVar("T")


@dataclass(frozen=True)
class Processes:
    """The processes of a run.

    Attributes:
        rank: this process's number; 0 writes files.
        size: how many there are.
        device: this process's own.
    """

    rank: int
    size: int
    device: torch.device

    @property
    def is_main(self) -> bool:
        return self.rank == 0

    def share(self, items: Sequence[T]) -> list[T]:
        """This process's part of a batch."""
        return list(items[self.rank :: self.size])

    def average_gradients(self, net: nn.Module) -> None:
        """Average the gradients of ``net`` over the processes, in place; every process must ask.

        Buffers (running statistics of batch normalization) stay each process's own. torch's
        DistributedDataParallel does the same, but would keep the group alive after it is left (joined_processes).
        """
        gradients = [p.grad for p in net.parameters() if p.grad is not None]
        if self.size == 1 or not gradients:
            return
        mean = self.sum(torch.cat([g.flatten() for g in gradients])) / self.size
        for gradient, part in zip(gradients, mean.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(part.view_as(gradient))

    def any(self, flag: bool) -> bool:
        """Whether any process says so; every process must ask."""
        if self.size == 1:
            return flag
        votes = torch.tensor(int(flag), device=self.device)
        dist.all_reduce(votes, dist.ReduceOp.MAX)
        return bool(votes.item())

    def sum(self, values: torch.Tensor) -> torch.Tensor:
        """Add ``values`` up over the processes, in place; every process must ask."""
        if self.size > 1:
            dist.all_reduce(values)
        return values

    def broadcast(self, values: list[float]) -> list[float]:
        """Process 0's numbers, in every process; all give as many."""
        if self.size == 1:
            return values
        tensor = torch.tensor(values, dtype=torch.float64, device=self.device)
        dist.broadcast(tensor, 0)
        return [float(v) for v in tensor.tolist()]


SINGLE_PROCESS = Processes(0, 1, torch.device("cpu"))
"""One process on the CPU."""


@contextlib.contextmanager
def joined_processes(device: torch.device | str | None = None) -> Iterator[Processes]:
    """Join the processes that ``torchrun`` started, by gloo on CPUs and NCCL on GPUs; leaves them at the end.

    Args:
        device: to work on; None takes GPUs if there are any. Of ``cuda`` without a number each process takes its own.
    """
    size = int(os.environ.get("WORLD_SIZE", "1"))
    chosen = find_device(device)
    if chosen.type == "cuda" and chosen.index is None:
        chosen = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")) % max(torch.cuda.device_count(), 1))
    if size == 1:
        yield Processes(0, 1, chosen)
        return
    if chosen.type == "cuda":
        torch.cuda.set_device(chosen)
    # A group that is still referred to after it is left keeps gloo's threads, and one of them may abort Python at its
    # end. These functions, which optimizers import, refer to the group that there is when they are imported.
    importlib.import_module("torch.distributed.nn.functional")
    dist.init_process_group("nccl" if chosen.type == "cuda" else "gloo")
    try:
        yield Processes(dist.get_rank(), size, chosen)
    finally:
        dist.destroy_process_group()
