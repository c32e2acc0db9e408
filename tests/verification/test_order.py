"""The integrator's order: the error of a smooth flight against its step."""

import numpy as np
import pytest
from verification.shown import check

from abhv_mc.array_types import Floats
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.world.earth import WGS84
from abhv_mc.shipped import shipped_configs
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc.verification.check_rows import Row
from abhv_mc.verification.fly_recording import make_replay_plan, make_start, replay

DURATION = 5.0  # s
STEPS = (0.1, 0.05, 0.025, 0.0125)  # s
EXACT = 0.0025  # s, the step of what is taken for exact: its error is 625 times smaller than the smallest
ORDER = 4.0
_GROUPS = {
    "velocity": slice(s.U, s.W + 1),
    "attitude": slice(s.Q0, s.Q3 + 1),
    "rates": slice(s.ROLL_RATE, s.YAW_RATE + 1),
}


def errors() -> dict[str, Floats]:
    """Largest error over a flight of a tumbling, damped brick at each of STEPS, by group of states.

    The brick flies fast enough to stay off zero air speed and within one layer of the atmosphere; its tables are
    constants: nothing in its equations has a kink.
    """
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "nesc" / "brick.yaml")
    rates = tuple(np.radians((100.0, 80.0, 120.0)))
    start = make_start(4000.0, (60.0, 40.0, -30.0), 0.4, rates, vehicle.constants.mass_start, 0.5)

    def fly(step: float) -> Floats:
        ticks = round(DURATION / step)
        plan = make_replay_plan(vehicle, WGS84, start, np.zeros((ticks + 1, 4)), Timing(step, 1, ticks))
        return replay(plan, nominal_parameters()[0])[:: round(STEPS[0] / step)]

    exact = fly(EXACT)
    flown = [np.abs(fly(step) - exact) for step in STEPS]
    return {name: np.array([error[:, group].max() for error in flown]) for name, group in _GROUPS.items()}


def test_order() -> None:
    """Slopes of the errors over the steps, both as logarithms, against 4."""
    assert slope(np.array(STEPS) ** 3.0) == pytest.approx(3.0)
    found = errors()
    check(
        [
            Row("step halving", "order 4", f"slope of the {name} error", "-", abs(slope(error) - ORDER), 0.2)
            for name, error in found.items()
        ]
    )
    for error in found.values():
        assert (error[:-1] / error[1:] > 13.0).all()


def slope(error: Floats) -> float:
    """Least-squares slope of log error over log step."""
    return float(np.polyfit(np.log(STEPS), np.log(error), 1)[0])
