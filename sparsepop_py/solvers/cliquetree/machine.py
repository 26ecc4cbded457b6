"""What the compiled kernels are made with: numba, the BLAS and LAPACK of scipy, vectors.

LLVM does not vectorise short loops well: it guards each against overlapping arrays, and leaves
what does not fill a vector to scalars. So the two innermost loops of all work on blocks are
written here in vectors of eight doubles, which LLVM cuts into what the processor has. All
addresses are byte addresses, all strides are bytes.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding
import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import get_cython_function_address, intrinsic

__all__ = ["LANES", "WORD", "inline", "jit", "products", "routine", "symmetric_products"]

LANES = 8  # doubles of a vector
WORD = 8  # bytes of a double
_REAL, _WORD, _HALF = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_VECTOR = ir.VectorType(_REAL, LANES)
_FAST = ("contract",)

_OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}}
_intrinsic: Any = intrinsic


def jit(function: Any) -> Any:
    """The function, compiled at its first call; kept on disk, without Python's lock."""
    return numba.njit(cache=True, nogil=True, **_OPTIONS)(function)


def inline(function: Any) -> Any:
    """The function, compiled into those that call it."""
    return numba.njit(inline="always")(function)


def routine(library: str, name: str, arguments: int) -> Any:
    """A routine of scipy by its address; all arguments are pointers."""
    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    llvmlite.binding.add_symbol(f"cliquetree_{name}", address)
    return types.ExternalFunction(f"cliquetree_{name}", types.void(*[types.intp] * arguments))


class _Sums:
    """Vectors summed up in registers for two rows, while the kernel's inner loop is built."""

    def __init__(self, builder: ir.IRBuilder) -> None:
        self.builder = builder
        self.held = [cgutils.alloca_once(builder, _VECTOR) for _ in range(2)]
        for place in self.held:
            builder.store(ir.Constant(_VECTOR, None), place)

    def at(self, base: Any, *offsets: Any) -> Any:
        for offset in offsets:
            base = self.builder.add(base, offset)
        return base

    def load(self, address: Any, kind: ir.Type, align: int = WORD) -> Any:
        pointer = self.builder.inttoptr(address, kind.as_pointer())
        return self.builder.load(pointer, align=align)

    def index(self, base: Any, number: Any) -> Any:
        """An entry of an array of uint32."""
        place = self.at(base, self.builder.mul(number, ir.Constant(_WORD, 4)))
        return self.builder.zext(self.load(place, _HALF, 4), _WORD)

    def spread(self, x: Any) -> Any:
        """A vector of equal numbers."""
        none, zero = ir.Constant(_VECTOR, ir.Undefined), ir.Constant(_HALF, 0)
        one = self.builder.insert_element(none, x, zero)
        return self.builder.shuffle_vector(
            one, none, ir.Constant(ir.VectorType(_HALF, LANES), None)
        )

    def times(self, a: Any, x: Any) -> Any:
        return self.builder.fmul(a, x, flags=_FAST)

    def add(self, row: int, address: Any, x: Any) -> None:
        """Add a number in memory times x to the sum of a row."""
        number = self.spread(self.load(address, _REAL))
        old = self.builder.load(self.held[row])
        new = self.builder.fadd(self.times(number, x), old, flags=_FAST)
        self.builder.store(new, self.held[row])

    def write(self, out: Any, stride: Any) -> None:
        for place in self.held:
            pointer = self.builder.inttoptr(out, _VECTOR.as_pointer())
            self.builder.store(self.builder.load(place), pointer, align=WORD)
            out = self.at(out, stride)

    @contextmanager
    def loop(self, low: Any, high: Any) -> Iterator[Any]:
        one = ir.Constant(_WORD, 1)
        with cgutils.for_range_slice(self.builder, low, high, one) as (number, _):
            yield number


@_intrinsic
def products(typing, out, stride, a, row, step, x, width, low, high):
    """Two rows of eight sums over k in [low, high) of a number times a vector.

    out[r * stride] = sum of a[r * row + k * step] * x[k * width] for r = 0, 1.
    """

    def build(context, builder, signature, arguments):
        out, stride, a, row, step, x, width, low, high = arguments
        sums = _Sums(builder)
        with sums.loop(low, high) as k:
            vector = sums.load(sums.at(x, builder.mul(k, width)), _VECTOR)
            first = sums.at(a, builder.mul(k, step))
            sums.add(0, first, vector)
            sums.add(1, sums.at(first, row), vector)
        sums.write(out, stride)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 9), build


@_intrinsic
def symmetric_products(typing, out, p, z, rows, columns, weights, width, r, t, low, high):
    """Two rows from r, eight entries from t, of P A Z + Z A P with A given by its nonzeros.

    The nonzeros low to high - 1 of the lower triangle stand in arrays of uint32 and of doubles,
    weights of the diagonal halved; ``width`` is the stride of all matrices, r and t are bytes.
    """

    def build(context, builder, signature, arguments):
        out, p, z, rows, columns, weights, width, r, t, low, high = arguments
        sums = _Sums(builder)
        word = ir.Constant(_WORD, WORD)
        with sums.loop(low, high) as k:
            i, j = (builder.mul(sums.index(base, k), width) for base in (rows, columns))
            weight = sums.spread(sums.load(sums.at(weights, builder.mul(k, word)), _REAL))
            for first, i_first, second, i_second in ((p, i, z, j), (p, j, z, i)):
                for left, at, right, other in (
                    (first, i_first, second, i_second),
                    (second, i_second, first, i_first),
                ):
                    vector = sums.times(weight, sums.load(sums.at(right, other, t), _VECTOR))
                    sums.add(0, sums.at(left, at, r), vector)
                    sums.add(1, sums.at(left, at, r, word), vector)
        sums.write(out, width)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 11), build
