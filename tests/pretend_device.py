"""A device that is none: what lies on it is as far from the CPU as on a GPU, but the CPU computes it.

Mixing what lies on it with what lies in memory fails, as on a GPU; so do numpy and the compiled kernels. The numbers
are the CPU's own. It goes by the name of torch's ``meta``, the only device but the CPU that every build of torch has.
"""

from __future__ import annotations

import contextlib
from typing import Any
from unittest import mock

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

DEVICE = torch.device("meta")
COPIES = {torch.ops.aten._to_copy.default, torch.ops.aten.copy_.default}
# Indices may lie in memory, on a GPU too.
INDEXED = {torch.ops.aten.index.Tensor, torch.ops.aten.index_put.default, torch.ops.aten.index_put_.default}
INDEXED |= {torch.ops.aten._index_put_impl_.default}


class _Far(Tensor):
    """A tensor on the device; ``near`` holds its numbers."""

    near: Tensor

    @staticmethod
    def __new__(cls, near: Tensor) -> _Far:
        place = (
            {"strides": near.stride(), "storage_offset": near.storage_offset()} if near.layout == torch.strided else {}
        )
        wrap = Tensor._make_wrapper_subclass  # type: ignore[attr-defined]
        far: _Far = wrap(cls, near.shape, dtype=near.dtype, device=DEVICE, **place)
        far.near = near
        return far

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _compute(func, args, kwargs or {})


class _Literals(TorchFunctionMode):
    """Tensors come from plain numbers, and become them, where no dispatch mode looks: that is done on the CPU."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if func is Tensor.new_tensor and args[0].device == DEVICE:
            return torch.tensor(*args[1:], **{"dtype": args[0].dtype, **kwargs}).to(DEVICE)
        if func in (torch.tensor, torch.as_tensor) and kwargs.get("device") == DEVICE:
            return func(*args, **{**kwargs, "device": None}).to(DEVICE)
        if func is Tensor.tolist and args[0].device == DEVICE:
            return args[0].cpu().tolist()
        return func(*args, **kwargs)


class PretendDevice(TorchDispatchMode):
    """While it is entered, ``DEVICE`` works, optimizers and mixed precision included; the latter changes nothing."""

    def __enter__(self) -> PretendDevice:
        self._stack = contextlib.ExitStack()
        self._stack.enter_context(_Literals())
        # Torch knows by name which devices have a fused Adam and mixed precision; ours computes on the CPU.
        self._stack.enter_context(mock.patch("torch.optim.adam._device_dtype_check_for_fused", return_value=None))
        self._stack.enter_context(mock.patch("torch.autocast", return_value=contextlib.nullcontext()))
        return super().__enter__()  # type: ignore[no-any-return]

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        self._stack.close()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _compute(func, args, kwargs or {})


def _compute(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    tensors = [value for value in tree_flatten((args, kwargs))[0] if isinstance(value, Tensor)]
    far = [value for value in tensors if isinstance(value, _Far)]
    held = tree_flatten((args[0], args[2:]))[0] if func in INDEXED else tensors
    strangers = [v for v in held if isinstance(v, Tensor) and not isinstance(v, _Far) and v.dim() > 0]
    if far and strangers and func not in COPIES:
        raise RuntimeError(f"{func}: of its tensors some lie on the device, one {tuple(strangers[0].shape)} does not")
    lands_far = bool(far)
    if "device" in kwargs and kwargs["device"] is not None:
        lands_far = torch.device(kwargs["device"]) == DEVICE
        kwargs = {**kwargs, "device": torch.device("cpu")}
    near_args, near_kwargs = tree_map(lambda v: v.near if isinstance(v, _Far) else v, (args, kwargs))
    result = func(*near_args, **near_kwargs)
    whose = {id(value.near): value for value in far}  # an operation in place returns the very tensor it changed

    def place(value: Any) -> Any:
        if not isinstance(value, Tensor) or not lands_far:
            return value
        return whose[id(value)] if id(value) in whose else _Far(value)

    return tree_map(place, result) if func is not torch.ops.aten.copy_.default else args[0]
