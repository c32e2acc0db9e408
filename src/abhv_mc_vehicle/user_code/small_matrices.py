"""Linear algebra of small matrices for custom laws; matrices are tuples of rows.

The functions are plain Python. While numba compiles a law, it calls the functions once with objects
that emit an instruction for each arithmetic operation. The compiled code has no loops or arrays and
returns the same bits as plain Python.
"""

import math
from collections.abc import Callable
from functools import partialmethod
from typing import Any

from abhv_mc_vehicle.kernel.jit import when_loaded


def matmul(a: Any, b: Any) -> Any:
    """Return the product of two matrices, or of a matrix and a vector.

    Parameters
    ----------
    a
        Matrix as a tuple of rows.
    b
        Matrix as a tuple of rows, or vector as a tuple of numbers.

    Returns
    -------
    tuple
        Rows of the product, or its numbers.

    Examples
    --------
    >>> matmul(((1.0, 2.0), (3.0, 4.0)), (1.0, 1.0))
    (3.0, 7.0)
    """
    if not isinstance(b[0], tuple):
        return tuple(_dot(row, b) for row in a)
    columns = tuple(zip(*b, strict=True))
    return tuple(tuple(_dot(row, column) for column in columns) for row in a)


def cholesky(a: Any) -> Any:
    """Return the Cholesky factor L of a positive definite matrix a = L L'.

    Parameters
    ----------
    a
        Positive definite matrix as a tuple of rows; its upper triangle is not read.

    Returns
    -------
    tuple
        Rows of L; numbers are NaN if ``a`` is not positive definite.

    Examples
    --------
    >>> cholesky(((4.0, 2.0), (2.0, 2.0)))
    ((2.0, 0.0), (1.0, 1.0))
    """
    rows: list[list[Any]] = []
    for i in range(len(a)):
        lower: list[Any] = []
        for j in range(i):
            lower.append(_ratio(_less(a[i][j], lower, rows[j][:j]), rows[j][j]))
        rows.append([*lower, _sqrt(_less(a[i][i], lower, lower))])
    return tuple((*row, *[0.0] * (len(a) - len(row))) for row in rows)


def solve(a: Any, b: Any) -> Any:
    """Solve a x = b by Gaussian elimination with row pivoting.

    Parameters
    ----------
    a
        Square matrix as a tuple of rows.
    b
        Vector as a tuple of numbers, or matrix as a tuple of rows.

    Returns
    -------
    tuple
        Numbers or rows of x; not finite if ``a`` is singular.

    Examples
    --------
    >>> solve(((2.0, 0.0), (0.0, 4.0)), (2.0, 2.0))
    (1.0, 0.5)
    """
    vector = not isinstance(b[0], tuple)
    n = len(a)
    sides = [(side,) for side in b] if vector else b
    rows: list[Any] = [[*row, *side] for row, side in zip(a, sides, strict=True)]
    for k in range(n):
        for i in range(k + 1, n):
            above = rows[k]
            below = rows[i]
            swap = abs(rows[i][k]) > abs(rows[k][k])
            rows[k] = [_choose(swap, y, x) for x, y in zip(above, below, strict=True)]
            rows[i] = [_choose(swap, x, y) for x, y in zip(above, below, strict=True)]
        for i in range(k + 1, n):
            factor = _ratio(rows[i][k], rows[k][k])
            rows[i] = [y - factor * x for x, y in zip(rows[k], rows[i], strict=True)]
    solved: list[Any] = [()] * n
    for k in reversed(range(n)):
        solved_columns = (
            zip(*solved[k + 1 :], strict=True) if k + 1 < n else [()] * len(rows[k][n:])
        )
        numerators = [
            _less(side, rows[k][k + 1 : n], x)
            for side, x in zip(rows[k][n:], solved_columns, strict=True)
        ]
        solved[k] = tuple(_ratio(side, rows[k][k]) for side in numerators)
    return tuple(x[0] for x in solved) if vector else tuple(solved)


def _dot(x: Any, y: Any) -> Any:
    (first, *products) = (u * v for u, v in zip(x, y, strict=True))
    total = first
    for product in products:
        total = total + product
    return total


def _less(value: Any, x: Any, y: Any) -> Any:
    """Return a value minus the products of corresponding elements of two rows, in order."""
    for u, v in zip(x, y, strict=True):
        value = value - u * v
    return value


def _ratio(x: Any, y: Any) -> Any:
    return math.nan if isinstance(y, float) and y == 0.0 else x / y


def _sqrt(x: Any) -> Any:
    if isinstance(x, _Emitted):
        return x.call("llvm.sqrt")
    return math.sqrt(x) if x >= 0.0 else math.nan


def _choose(condition: Any, x: Any, y: Any) -> Any:
    if isinstance(condition, bool):
        return x if condition else y
    return _Emitted(x.builder, x.builder.select(condition, x.value, y.value))


class _Emitted:
    """Number in compiled code; its operations emit LLVM instructions."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder = builder
        self.value = value

    def _emit(self, instruction: str, other: "_Emitted") -> "_Emitted":
        return _Emitted(self.builder, getattr(self.builder, instruction)(self.value, other.value))

    __add__ = partialmethod(_emit, "fadd")
    __sub__ = partialmethod(_emit, "fsub")
    __mul__ = partialmethod(_emit, "fmul")
    __truediv__ = partialmethod(_emit, "fdiv")

    def __abs__(self) -> "_Emitted":
        return self.call("llvm.fabs")

    def __gt__(self, other: "_Emitted") -> Any:
        return self.builder.fcmp_ordered(">", self.value, other.value)

    def call(self, name: str) -> "_Emitted":
        """Return the result of an LLVM intrinsic applied to the number."""
        function = self.builder.module.declare_intrinsic(name, [self.value.type])
        return _Emitted(self.builder, self.builder.call(function, [self.value]))


@when_loaded
def _compile_all() -> None:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic, overload

    tuples: Any = types.BaseTuple
    emit: Any = intrinsic  # numba supplies the first argument of the decorated functions.

    def identity(kind: Any, row: int | None = None) -> Any:
        """Return the identity matrix with the shape of a tuple type."""
        if not isinstance(kind, tuples):
            raise TypeError(kind)
        return tuple(
            float(i == row) if isinstance(item, types.Number) else identity(item, i)
            for i, item in enumerate(kind)
        )

    def type_of(value: Any) -> Any:
        return (
            types.Tuple([type_of(item) for item in value])
            if isinstance(value, tuple)
            else types.float64
        )

    def emitted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, tuples):
            return tuple(
                emitted(context, builder, item, builder.extract_value(value, i))
                for i, item in enumerate(kind)
            )
        return _Emitted(builder, context.cast(builder, value, kind, types.float64))

    def packed(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(value, tuple):
            items = [
                packed(context, builder, *pair) for pair in zip(kind.types, value, strict=True)
            ]
            return context.make_tuple(builder, kind, items)
        if isinstance(value, _Emitted):
            return value.value
        return ir.Constant(ir.DoubleType(), value)

    def make(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        """Return the numba type and code generator of the result, or None for wrong shapes."""
        try:
            result = type_of(function(*map(identity, arguments)))
        except (ValueError, IndexError, TypeError):
            return None

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            operands = (
                emitted(context, builder, *pair) for pair in zip(arguments, values, strict=True)
            )
            return packed(context, builder, result, function(*operands))

        return result(*arguments), generate

    @emit
    def emit_matmul(typing_context: Any, a: Any, b: Any) -> Any:
        return make(matmul, (a, b))

    @emit
    def emit_cholesky(typing_context: Any, a: Any) -> Any:
        return make(cholesky, (a,))

    @emit
    def emit_solve(typing_context: Any, a: Any, b: Any) -> Any:
        return make(solve, (a, b))

    options: Any = {"jit_options": {"forceinline": True}, "strict": False}
    overload(matmul, **options)(lambda a, b: lambda a, b: emit_matmul(a, b))  # noqa: PLW0108
    overload(cholesky, **options)(lambda a: lambda a: emit_cholesky(a))  # noqa: PLW0108
    overload(solve, **options)(lambda a, b: lambda a, b: emit_solve(a, b))  # noqa: PLW0108
