"""Tools for compiled kernels: numba, the BLAS and LAPACK of scipy, vectors.

LLVM does not vectorise short loops well: it guards each against overlapping arrays, and leaves
loops that do not fill a vector to scalars. So all work on blocks is written here in vectors of
eight doubles, which LLVM splits into those of the processor. They are loaded from and stored to
addresses in bytes; between these they are added and multiplied like numbers.
"""

# mypy: disallow-untyped-defs=False
from __future__ import annotations

import operator
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import (
    get_cython_function_address,
    intrinsic,
    lower_builtin,
    models,
    register_model,
)

__all__ = ["LANES", "WORD", "all_positive", "filled", "inline", "is_kept", "jit", "largest", "load"]
__all__ += ["root", "routine", "spread", "store", "total"]

LANES = 8  # doubles of a vector
WORD = 8  # bytes of a double
_REAL, _FLAGS = ir.DoubleType(), ir.IntType(LANES)
_VECTOR = ir.VectorType(_REAL, LANES)
_FAST = ("contract",)
_ADDRESS = types.intp

_OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}}
_intrinsic: Any = intrinsic


def jit(function: Any) -> Any:
    """Compile a function at its first call; keep it on disk, without Python's lock."""
    return numba.njit(cache=True, nogil=True, **_OPTIONS)(function)


def is_kept(function: Any) -> bool:
    """Check that a function of :func:`jit` is compiled, or its machine code on disk.

    Parameters
    ----------
    function : callable
    """
    if function.signatures:
        return True
    made = function.py_func
    try:
        written = Path(made.__code__.co_filename).stat().st_mtime
        found = Path(function.stats.cache_path).glob(f"*.{made.__name__}-*.nbi")
        return any(path.stat().st_mtime >= written for path in found)
    except OSError:
        return False


def inline(function: Any) -> Any:
    """Compile a function into those that call it."""
    return numba.njit(inline="always")(function)


def routine(library: str, name: str, arguments: int) -> Any:
    """Look up a routine of scipy by its address; all arguments are pointers."""
    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    llvmlite.binding.add_symbol(f"cliquetree_{name}", address)
    return types.ExternalFunction(f"cliquetree_{name}", types.void(*[types.intp] * arguments))


class _Vector(types.Type):
    """The type of a vector, for numba."""

    def __init__(self) -> None:
        super().__init__(name="vector of doubles")


_vector = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)  # type: ignore[no-untyped-call]


def _operator(which: Any, instruction: str) -> None:
    @infer_global(which)
    class _Typing(ConcreteTemplate):
        cases = [signature(_vector, _vector, _vector)]

    @lower_builtin(which, _vector, _vector)
    def _build(context, builder, signature, arguments):
        return getattr(builder, instruction)(*arguments, flags=_FAST)


for _which, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _operator(_which, _name)


def _spread(builder: ir.IRBuilder, x: Any) -> Any:
    none, zero = ir.Constant(_VECTOR, ir.Undefined), ir.Constant(ir.IntType(32), 0)
    one = builder.insert_element(none, x, zero)
    places = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
    return builder.shuffle_vector(one, none, places)


@_intrinsic
def load(typing, address):
    """Load the vector at an address."""

    def build(context, builder, signature, arguments):
        return builder.load(builder.inttoptr(arguments[0], _VECTOR.as_pointer()), align=WORD)

    return _vector(_ADDRESS), build


@_intrinsic
def store(typing, address, vector):
    """Put a vector to an address."""

    def build(context, builder, signature, arguments):
        builder.store(
            arguments[1], builder.inttoptr(arguments[0], _VECTOR.as_pointer()), align=WORD
        )
        return context.get_dummy_value()

    return types.void(_ADDRESS, _vector), build


@_intrinsic
def spread(typing, address):
    """Fill a vector with the number at an address."""

    def build(context, builder, signature, arguments):
        pointer = builder.inttoptr(arguments[0], _REAL.as_pointer())
        return _spread(builder, builder.load(pointer, align=WORD))

    return _vector(_ADDRESS), build


@_intrinsic
def number(typing, address):
    """Load the number at an address."""

    def build(context, builder, signature, arguments):
        return builder.load(builder.inttoptr(arguments[0], _REAL.as_pointer()), align=WORD)

    return types.float64(_ADDRESS), build


@_intrinsic
def index(typing, address):
    """Load the integer at an address."""

    def build(context, builder, signature, arguments):
        pointer = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
        return builder.load(pointer, align=WORD)

    return types.int64(_ADDRESS), build


@_intrinsic
def put(typing, address, number):
    """Put a number to an address."""

    def build(context, builder, signature, arguments):
        builder.store(arguments[1], builder.inttoptr(arguments[0], _REAL.as_pointer()), align=WORD)
        return context.get_dummy_value()

    return types.void(_ADDRESS, types.float64), build


@_intrinsic
def filled(typing, number):
    """Fill a vector with a number."""

    def build(context, builder, signature, arguments):
        return _spread(builder, arguments[0])

    return _vector(types.float64), build


@_intrinsic
def root(typing, vector):
    """Compute the square roots of a vector's entries."""

    def build(context, builder, signature, arguments):
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        made = cgutils.get_or_insert_function(builder.module, kind, f"llvm.sqrt.v{LANES}f64")
        return builder.call(made, arguments)

    return _vector(_vector), build


@_intrinsic
def all_positive(typing, vector):
    """Check that all entries are positive."""

    def build(context, builder, signature, arguments):
        found = builder.fcmp_ordered(">", arguments[0], ir.Constant(_VECTOR, None))
        flags = builder.bitcast(found, _FLAGS)
        return builder.icmp_unsigned("==", flags, ir.Constant(_FLAGS, 2**LANES - 1))

    return types.boolean(_vector), build


def _reduction(name: str, *start: float) -> Any:
    """Build a reduction of all entries of a vector by LLVM's name."""

    @_intrinsic
    def reduction(typing, vector):
        def build(context, builder, signature, arguments):
            full = f"llvm.vector.reduce.{name}.v{LANES}f64"
            kind = ir.FunctionType(_REAL, [*[_REAL] * len(start), _VECTOR])
            made = cgutils.get_or_insert_function(builder.module, kind, full)
            first = [ir.Constant(_REAL, number) for number in start]
            return builder.call(made, [*first, *arguments], fastmath=("reassoc",))

        return types.float64(_vector), build

    return reduction


largest, total = _reduction("fmax"), _reduction("fadd", -0.0)
