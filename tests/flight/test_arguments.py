"""What compiled code relies on is checked where Python enters: types, shapes, order and alignment."""

import dataclasses

import numpy as np
import pytest
from short_flights import short_plan

from abhv_mc.flight.arguments import make_kernel_plan
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.plan import Recording


@pytest.fixture(scope="module")
def plan():
    return short_plan(5, mission="level")


def misaligned(array):
    """The same numbers from the second byte of a buffer on."""
    buffer = bytearray(array.nbytes + 1)
    buffer[1:] = np.ascontiguousarray(array).tobytes()
    view = np.frombuffer(buffer, array.dtype, array.size, 1).reshape(array.shape)
    assert not view.flags.aligned
    return view


def with_arrays(plan, change):
    """The plan with an array of each of its parts changed."""
    tables = plan.vehicle.tables
    tables = tables._replace(data=change(tables.data), group_axis=change(tables.group_axis))
    vehicle = plan.vehicle._replace(
        tables=tables, foreign=plan.vehicle.foreign._replace(digest=change(plan.vehicle.foreign.digest))
    )
    return dataclasses.replace(
        plan,
        vehicle=vehicle,
        reference=change(plan.reference),
        gains=change(plan.gains),
        initial_state=change(plan.initial_state),
    )


def spread_out(array):
    """Every other number of an array of twice the length: not contiguous."""
    wide = np.repeat(array, 2, axis=-1)
    return wide[..., ::2]


@pytest.mark.parametrize("change", [misaligned, spread_out])
def test_the_kernel_gets_only_arrays_it_can_rely_on(plan, change):
    made = make_kernel_plan(with_arrays(plan, change), nominal_parameters(), Recording(0))
    of_vehicle = made.vehicle.tables.data, made.vehicle.tables.group_axis, made.vehicle.foreign.digest
    for array in (*of_vehicle, made.reference, made.gains, made.initial_state):
        assert array.flags.aligned and array.flags.c_contiguous and array.flags.writeable


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"gains": np.zeros((6, 32), np.float32)}, "plan.gains is an array of float32, not an array of float64"),
        ({"gains": np.zeros((6, 31))}, r"plan.gains has the shape \(6, 31\), not \(any, 32\)"),
        ({"gains": np.zeros((5, 32))}, "has 5 rows for control ticks 0 to 5"),
        ({"initial_state": np.zeros((22, 1))}, r"initial_state has the shape \(22, 1\), not \(22\)"),
        ({"parameters": nominal_parameters()[:, 1:]}, "parameters has the shape"),
        ({"parameters": nominal_parameters() + 0j}, "parameters is an array of complex128, not an array of float64"),
    ],
)
def test_wrong_types_and_shapes_are_refused(plan, change, sentence):
    parameters = change.get("parameters", nominal_parameters())
    changed = {name: array for name, array in change.items() if name != "parameters"}
    with pytest.raises(ValueError, match=sentence):
        fly(dataclasses.replace(plan, **changed), parameters)
