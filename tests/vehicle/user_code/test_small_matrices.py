"""Tests of small matrices in custom laws against numpy, in plain Python and compiled code."""

import numpy as np
import pytest
from short_flights import short_plan, write_law

from abhv_mc.extend import cholesky, matmul, solve
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.jit import scalar


def rows(array):
    """Return an array as tuples."""
    return tuple(map(rows, array)) if np.ndim(array) else float(array)


def matrices(n, m):
    generator = np.random.default_rng(n)
    a, b = generator.normal(size=(n, n)), generator.normal(size=(n, m))
    a[0, 0] = 0.0  # elimination has to exchange rows
    return a, b


@scalar
def all_three(a, b, p):
    return matmul(a, b), solve(a, b), matmul(a, b[0]), solve(a, b[0]), cholesky(p)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_plain_python_agrees_with_numpy(n):
    a, b = matrices(n, 4)
    positive = a @ a.T + np.eye(n)
    np.testing.assert_allclose(matmul(rows(a), rows(b)), a @ b, atol=1e-13)
    np.testing.assert_allclose(solve(rows(a), rows(b)), np.linalg.solve(a, b), rtol=1e-11)
    np.testing.assert_allclose(matmul(rows(a), rows(b[:, 0])), a @ b[:, 0], atol=1e-13)
    np.testing.assert_allclose(
        solve(rows(a), rows(b[:, 0])), np.linalg.solve(a, b[:, 0]), rtol=1e-11
    )
    factor = np.array(cholesky(rows(np.tril(positive))))
    np.testing.assert_allclose(factor, np.linalg.cholesky(positive), atol=1e-13)


def test_compiled_code_has_the_bits_of_plain_python():
    a, b = matrices(3, 3)
    arguments = rows(a), rows(b), rows(a @ a.T + np.eye(3))
    compiled, plain = all_three(*arguments), all_three.py_func(*arguments)
    for compiled_value, value in zip(compiled, plain, strict=True):
        np.testing.assert_array_equal(compiled_value, value)


def test_a_matrix_without_a_factor_or_an_inverse_gives_no_numbers():
    assert np.isnan(cholesky(((1.0, 2.0), (2.0, 1.0)))[1][1])
    assert np.isnan(solve(((1.0, 2.0), (2.0, 4.0)), (1.0, 0.0))).any()


LAW = """\
from abhv_mc.extend import Command, controller, matmul, solve

@controller
def law(measured, reference):
    a = ((2.0, measured.roll_rate), (1, 3.0))
    x, y = solve(a, matmul(a, (reference.elevator, MEASURED)))
    return Command(0.0, 0.0, x, reference.equivalence_ratio, bank=y)
"""


def test_a_law_uses_them(tmp_path):
    plan = short_plan(5, write_law(tmp_path, LAW.replace("MEASURED", "measured.pitch_rate")))
    block = fly(plan, nominal_parameters(), 1)
    values = block.history[0][:, [CHANNEL_INDEX[f"{n}_dps"] for n in ("pitch_rate_measured",)]]
    bank = block.history[0][:, [CHANNEL_INDEX["bank_command_deg"]]]
    np.testing.assert_allclose(bank, values, rtol=1e-6, atol=1e-12)


def test_shapes_that_do_not_fit_are_an_error_at_the_line(tmp_path):
    text = LAW.replace("(reference.elevator, MEASURED)", "(1.0, 2.0, 3.0)")
    with pytest.raises(InputError, match=r"law\.py:6.*matmul.*float64 x 3"):
        short_plan(5, write_law(tmp_path, text))
