"""Colors in compiled kernels: red, green and blue as one vector, and asking for memory before it is needed.

Written per channel, the loops over taps were bound by the processor, not by memory: one vector for three numbers makes
them a third faster. Rows of four numbers of which the last is spare (see `mipmap`) never straddle a cache line, which
makes them half as long again.

Taps read texels all over a list of tens of megabytes, and a step of the optimizer between two reads has emptied the
caches: a gather then waits for memory at every tap. The addresses are known long before, so the kernels ask AHEAD.
Where the caches are cold, as they are in a run, this is 2.5 times as fast; where they are warm, a quarter slower.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

CHANNELS = 3
AHEAD = 256  # taps: 16 KiB of texels on their way

_READ, _KEEP, _DATA = 0, 3, 1  # arguments of the prefetch instruction: no write, all cache levels, not code


class Color(types.Type):
    """Three numbers of one floating-point type."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Color({dtype})")


@register_model(Color)
class _ColorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, color: Color) -> None:
        super().__init__(manager, color, _vector(color.dtype))


def _vector(dtype: Any) -> Any:
    return ir.VectorType(ir.FloatType() if dtype == types.float32 else ir.DoubleType(), CHANNELS)


def row_address(context: Any, builder: Any, array_type: Any, array: Any, row_type: Any, row: Any) -> Any:
    """The address, an integer, of row ``row`` of a 2-D array."""
    data = context.make_array(array_type)(context, builder, array)
    stride = cgutils.unpack_tuple(builder, data.strides, 2)[0]
    offset = builder.mul(context.cast(builder, row, row_type, types.intp), stride)
    return builder.add(builder.ptrtoint(data.data, stride.type), offset)


def _convert(builder: Any, vector: Any, before: Any, after: Any) -> Any:
    if before == after:
        return vector
    convert = builder.fpext if after == types.float64 else builder.fptrunc
    return convert(vector, _vector(after))


@intrinsic  # numba passes the first argument of each itself
def _black(_context: Any) -> Any:
    """Zeros, float64: where many colors are summed up."""
    return Color(types.float64)(), lambda *_: ir.Constant(_vector(types.float64), [0.0] * CHANNELS)


@intrinsic
def _load(_context: Any, array: Any, row: Any) -> Any:
    """The first three numbers of ``array[row]``, a row without gaps. ``row`` must lie inside."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_type, row_type = signature.args
        address = row_address(context, builder, array_type, arguments[0], row_type, arguments[1])
        pointer = builder.inttoptr(address, ir.PointerType(_vector(array_type.dtype)))
        return builder.load(pointer, align=array_type.dtype.bitwidth // 8)

    return Color(array.dtype)(array, row), generate


@intrinsic
def _store(_context: Any, array: Any, row: Any, color: Any) -> Any:
    """``array[row, :3] = color``, rounded to the array's type. ``row`` must lie inside."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_type, row_type, color_type = signature.args
        address = row_address(context, builder, array_type, arguments[0], row_type, arguments[1])
        pointer = builder.inttoptr(address, ir.PointerType(_vector(array_type.dtype)))
        value = _convert(builder, arguments[2], color_type.dtype, array_type.dtype)
        builder.store(value, pointer, align=array_type.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, row, color), generate


@intrinsic
def _add(_context: Any, total: Any, weight: Any, color: Any) -> Any:
    """``total + weight * color``: the product in the color's type, the sum in the total's."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total_type, weight_type, color_type = signature.args
        scalar = context.cast(builder, arguments[1], weight_type, color_type.dtype)
        weights: Any = ir.Constant(_vector(color_type.dtype), ir.Undefined)
        for lane in range(CHANNELS):
            weights = builder.insert_element(weights, scalar, ir.Constant(ir.IntType(32), lane))
        product = builder.fmul(weights, arguments[2])
        return builder.fadd(arguments[0], _convert(builder, product, color_type.dtype, total_type.dtype))

    return total(total, weight, color), generate


@intrinsic
def _is_black(_context: Any, color: Any) -> Any:
    """Whether all three are zero; NaN is not."""

    def generate(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        zero = ir.Constant(_vector(signature.args[0].dtype), [0.0] * CHANNELS)
        equal = builder.fcmp_ordered("==", arguments[0], zero)
        lanes = [builder.extract_element(equal, ir.Constant(ir.IntType(32), lane)) for lane in range(CHANNELS)]
        return builder.and_(builder.and_(lanes[0], lanes[1]), lanes[2])

    return types.boolean(color), generate


@intrinsic
def _prefetch(_context: Any, array: Any, row: Any) -> Any:
    """Inside a kernel: start to fetch ``array[row]`` of a 2-D array, without waiting. ``row`` must lie inside."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_type, row_type = signature.args
        place = row_address(context, builder, array_type, arguments[0], row_type, arguments[1])
        address = builder.inttoptr(place, ir.PointerType(ir.IntType(8)))
        number = ir.IntType(32)
        of_type = ir.FunctionType(ir.VoidType(), [address.type, number, number, number])
        instruction = cgutils.get_or_insert_function(builder.module, of_type, "llvm.prefetch.p0")
        builder.call(instruction, [address, number(_READ), number(_KEEP), number(_DATA)])
        return context.get_dummy_value()

    return types.void(array, row), generate


add: Any = _add
black: Any = _black
is_black: Any = _is_black
load: Any = _load
prefetch: Any = _prefetch
store: Any = _store
