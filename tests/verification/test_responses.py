"""Step responses: what is promised, and that a loop too near to the one inside it is seen."""

import numpy as np
import pytest

from abhv_mc.control.controller_file import read_controller
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.verification.responses import CASES, promised, response, slowed


def test_the_promise_is_the_second_order_loop_with_its_integral():
    times = np.linspace(0.0, 10.0, 1001)
    found = promised(2.4, 0.5, times)
    assert found[0] == pytest.approx(1.0)
    # x' = -a2 x - a1 z, z' = x: integrated by Heun's method
    x, z, step = 1.0, 0.0, times[1]
    for value in found[1:]:
        dx, dz = -2.4 * x - 0.25 * z, x
        dx2, dz2 = -2.4 * (x + step * dx) - 0.25 * (z + step * dz), x + step * dx
        x, z = x + 0.5 * step * (dx + dx2), z + 0.5 * step * (dz + dz2)
        assert value == pytest.approx(x, abs=1e-4)


def test_a_response_starts_with_its_error_and_table_1_is_not_separated():
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "ghame_x.yaml")
    case = CASES[0]
    _, apart = response(vehicle, slowed(case.loop), 1.0, case)
    assert apart[0] == pytest.approx(1.0, abs=0.01)
    times, near = response(vehicle, read_controller(shipped_configs() / "control" / "tlc.yaml"), 1.0, case)
    assert near[0] == pytest.approx(1.0, abs=0.01)
    assert np.abs(near - promised(3.4, 1.2, times)).max() > 0.2
