"""What the leaner compiler makes is what numba makes, and numba is left as it was."""

import gc

import numba
import numpy as np
import pytest
from abhv_mc.jit_compiler import KernelCompiler
from numba.core import types

from abhv_mc import jit_compiler
from abhv_mc.jit import lanes, routine, scalar

kernel = numba.njit(error_model="numpy", pipeline_class=KernelCompiler)  # as in jit, but compiled anew each time


@scalar
def cube(x):
    return x * x * x


@lanes
def cubes(Z, width):
    for lane in range(width):
        Z[1, lane] = cube(Z[0, lane]) / (1.0 - Z[0, lane])


@routine
def total(row):
    sum_ = 0.0
    for x in row:
        sum_ += x
    return sum_


@kernel
def fly(Z, width):
    cubes(Z, width)
    return total(Z[1, :width])


def numbers():
    return np.random.default_rng(1).normal(size=(2, 16))


@pytest.mark.parametrize("width", [1, 7, 16])
def test_as_python(width):
    """Bit for bit, through every depth of calls, for any number of lanes."""
    compiled, plain = numbers(), numbers()
    for lane in range(width):
        plain[1, lane] = plain[0, lane] * plain[0, lane] * plain[0, lane] / (1.0 - plain[0, lane])
    assert fly(compiled, width) == sum(plain[1, :width].tolist())
    np.testing.assert_array_equal(compiled, plain)


def test_a_scalar_has_an_entry_from_python():
    assert cube(3.0) == 27.0 and cube(3) == 27
    assert cube.py_func(2.0) == 8.0


def test_numba_is_as_it_was(monkeypatch):
    before = types.BaseFunction.get_call_type
    inside = []

    @kernel
    def count(x):
        return cube(x) + 1.0

    ask = jit_compiler._recall
    monkeypatch.setattr(jit_compiler, "_recall", lambda *a: (inside.append(gc.isenabled()), ask(*a))[1])
    assert count(2.0) == 9.0
    assert inside and not any(inside)  # no search for garbage meanwhile
    assert types.BaseFunction.get_call_type is before and gc.isenabled()


def test_numba_is_as_it_was_after_a_fault():
    before = types.BaseFunction.get_call_type

    @kernel
    def wrong(x):
        return x.nothing

    with pytest.raises(numba.TypingError):
        wrong(1.0)
    assert types.BaseFunction.get_call_type is before and gc.isenabled()


def test_operations_are_remembered_by_type():
    """1 / 2 of integers is another operation than of floats, and so are an index and a slice."""

    @kernel
    def mixed(row, i, x):
        return row[i] / 2.0 + row[: i + 1][0] / 2 + i // 2 + x * i

    row = np.array([1.0, 5.0, 9.0])
    assert mixed(row, 2, 0.5) == mixed.py_func(row, 2, 0.5) == 7.0
    assert mixed(row, 1, 2) == mixed.py_func(row, 1, 2)
    assert mixed(np.array([1, 5, 9]), 2, 0.5) == mixed.py_func(np.array([1, 5, 9]), 2, 0.5)


def test_numbas_own_functions_may_call_ours():
    """Everything that is called at any depth comes with it."""

    @scalar
    def power_nine(x):
        return cube(cube(x))

    @numba.njit
    def user(x):
        return power_nine(x) + cube(x)

    assert user(2.0) == 520.0


def test_what_only_a_later_call_needs_is_linked():
    """The first caller's branch is dead for this argument, so that nobody calls ``cube`` when it is linked."""

    @lanes
    def first(Z, width, wanted):
        if wanted:
            cubes(Z, width)
        Z[1, 0] = 1.0

    @lanes
    def second(Z, width):
        cubes(Z, width)

    @kernel
    def both(Z, width):
        first(Z, width, False)
        second(Z, width)

    ours, wanted = numbers(), numbers()
    both(ours, 16)
    fly(wanted, 16)
    np.testing.assert_array_equal(ours, wanted)
