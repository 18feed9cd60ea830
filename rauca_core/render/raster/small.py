"""Triangles whose box has at most 2 x 2 samples, tested all three edges at a time.

On a small picture of a car nearly all triangles are such, and half of them hold no sample after all. Which do is asked
without a branch, since no processor can guess.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ..kernels import njit
from .fixed_point import FRACTION, ONE

LARGE = 16  # marks a triangle that was not asked; bits 0 to 3 are the samples of a small one, row by row

_BIT, _BYTE, _WORD, _LONG = ir.IntType(4), ir.IntType(8), ir.IntType(32), ir.IntType(64)
_WORDS, _LONGS = ir.VectorType(_WORD, 4), ir.VectorType(_LONG, 4)
_SPARE, _ALL = 0b1000, 0b1111  # signs of four lanes, of which the last has no edge and is always negative


@njit(cache=True, nogil=True, error_model="numpy")
def mark_samples(
    live: Any, boxes: Any, corners: Any, fixed: Any, columns: int, lines: Any, y0: int, marks: Any, found: Any
) -> int:
    """Mark which samples each triangle of ``live`` (L,) holds; list in ``found`` those that hold any; how many.

    Triangles with larger boxes are marked LARGE, and so are all where a pixel has several columns.
    """
    ys, shifts, xs_of, ys_of = lines[0], lines[1], fixed[0], fixed[1]
    number = np.uint64(0)
    for n in range(np.uint64(live.shape[0])):
        t = np.uint32(live[n])
        i, j, k = np.uint32(corners[t, 0]), np.uint32(corners[t, 1]), np.uint32(corners[t, 2])
        left, top, right, bottom = -boxes[n, 0], -boxes[n, 1], boxes[n, 2], boxes[n, 3]
        upper, lower = np.uint64(top - y0), np.uint64(bottom - y0)
        x, y = left * ONE + shifts[upper], ys[upper]
        slant, down = shifts[lower] - shifts[upper], ys[lower] - y
        mark = held(xs_of[i] - x, xs_of[j] - x, xs_of[k] - x, ys_of[i] - y, ys_of[j] - y, ys_of[k] - y, slant, down)
        wide, tall = np.uint8(right > left), np.uint8(bottom > top)
        mark &= np.uint8(1 | wide << 1 | tall << 2 | (wide & tall) << 3)
        large = (columns > 1) | (right - left > 1) | (bottom - top > 1)
        marks[n] = np.uint8(LARGE) if large else mark
        found[number] = n
        number += np.uint64(marks[n] != 0)
    return int(number)


@intrinsic  # numba passes the first argument itself
def _held(_context: Any, ax: Any, bx: Any, cx: Any, ay: Any, by: Any, cy: Any, slant: Any, down: Any) -> Any:
    """Which of four samples the triangle a, b, c holds, a bit each: those at 0, a column to the right, and below both.

    The row below lies ``slant`` to the right and ``down``. The answer means something if all numbers fit into 31 bits.

    An edge function less one where the edge loses ties is negative outside a triangle that turns one way, and its
    complement is outside one that turns the other way: so a sample is inside where all three signs agree. Only a
    triangle without area could deceive; three edge functions add up to the area.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = [context.cast(builder, v, t, types.int32) for v, t in zip(arguments, signature.args, strict=True)]
        x, y = _lanes(builder, [*words[0:3], words[0]]), _lanes(builder, [*words[3:6], words[3]])
        following = ir.Constant(_WORDS, [1, 2, 0, 3])
        dx, dy = (builder.sub(builder.shuffle_vector(v, v, following), v) for v in (x, y))
        long_x, long_y, long_dx, long_dy = (builder.sext(v, _LONGS) for v in (x, y, dx, dy))
        edges = builder.sub(builder.mul(long_dy, long_x), builder.mul(long_dx, long_y))
        at = builder.sub(edges, builder.zext(_loses_ties(builder, dx, dy), _LONGS))
        beside = builder.shl(long_dy, ir.Constant(_LONGS, [FRACTION] * 4))
        slants, downs = (builder.sext(_lanes(builder, [word] * 4), _LONGS) for word in words[6:])
        below = builder.sub(builder.add(at, builder.mul(long_dx, downs)), builder.mul(long_dy, slants))
        mark: Any = _BYTE(0)
        for place, values in enumerate((at, builder.sub(at, beside), below, builder.sub(below, beside))):
            signs = builder.bitcast(builder.icmp_signed("<", values, ir.Constant(_LONGS, [0] * 4)), _BIT)
            agree = builder.or_(*(builder.icmp_unsigned("==", signs, _BIT(s)) for s in (_SPARE, _ALL)))
            mark = builder.or_(mark, builder.shl(builder.zext(agree, _BYTE), _BYTE(place)))
        of_type = ir.FunctionType(_LONG, [_LONGS])
        total = cgutils.get_or_insert_function(builder.module, of_type, "llvm.vector.reduce.add.v4i64")
        area = builder.call(total, [edges])
        return builder.select(builder.icmp_signed("!=", area, _LONG(0)), mark, _BYTE(0))

    return types.uint8(ax, bx, cx, ay, by, cy, slant, down), generate


def _lanes(builder: Any, words: list[Any]) -> Any:
    vector: Any = ir.Constant(_WORDS, ir.Undefined)
    for lane, word in enumerate(words):
        vector = builder.insert_element(vector, word, _WORD(lane))
    return vector


def _loses_ties(builder: Any, dx: Any, dy: Any) -> Any:
    """Where an edge does not own the samples on it: it is neither a left edge, which rises, nor a top one."""
    zero = ir.Constant(_WORDS, [0] * 4)
    level = builder.and_(builder.icmp_signed("==", dy, zero), builder.icmp_signed(">", dx, zero))
    return builder.not_(builder.or_(builder.icmp_signed("<", dy, zero), level))


held: Any = _held
