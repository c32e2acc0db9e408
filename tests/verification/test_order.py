"""Tests of the integrator's order: the error of a smooth flight against its step.

They also measure the error of the default step.
"""

import numpy as np
import pytest
from verification.shown import check

from abhv_mc.flights.timing import Timing
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.check_rows import Row
from benchmarks.verification.fly_recording import make_replay_plan, make_start, replay

DURATION = 5.0  # s
STEPS = (0.1, 0.05, 0.025, 0.0125)  # s
# s, the step of what is taken for exact: its error is 625 times smaller than the smallest
EXACT = 0.0025
ORDER = 4.0
_GROUPS = {
    "velocity": slice(s.U, s.W + 1),
    "attitude": slice(s.Q0, s.Q3 + 1),
    "rates": slice(s.ROLL_RATE, s.YAW_RATE + 1),
}


def errors():
    """Largest error over a flight of a tumbling, damped brick at each of STEPS, by group of states.

    The brick flies fast enough to stay off zero air speed and within one layer of the atmosphere;
    its tables are constants: nothing in its equations has a kink.
    """
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "nesc" / "brick.yaml")
    rates = tuple(np.radians((100.0, 80.0, 120.0)))
    start = make_start(
        4000.0, (60.0, 40.0, -30.0), 0.4, rates, vehicle.constants.mass_start, latitude=0.5
    )

    def fly(step):
        ticks = round(DURATION / step)
        plan = make_replay_plan(
            vehicle, WGS84, start, np.zeros((ticks + 1, 4)), Timing(step, 1, ticks)
        )
        return replay(plan, nominal_parameters()[0])[:: round(STEPS[0] / step)]

    exact = fly(EXACT)
    flown = [np.abs(fly(step) - exact) for step in STEPS]
    return {
        name: np.array([error[:, group].max() for error in flown])
        for name, group in _GROUPS.items()
    }


def test_order():
    """Least-squares slopes of the errors over the steps, both as logarithms, against 4."""
    errors_by_step = errors()
    slopes = {
        name: np.polyfit(np.log(STEPS), np.log(error), 1)[0]
        for name, error in errors_by_step.items()
    }
    check(
        [
            Row(
                "step halving",
                "order 4",
                f"slope of the {name} error",
                "-",
                abs(float(slope) - ORDER),
                0.2,
            )
            for name, slope in slopes.items()
        ]
    )
    for error in errors_by_step.values():
        assert (error[:-1] / error[1:] > 13.0).all()


@pytest.mark.thorough
def test_half_the_default_step_moves_every_metric_by_less_than_one_percent_of_its_spread():
    """Return TLC's S manoeuvre under the paper's dispersions (Zhu and Shen 2014).

    Section 7: uniform distributions, half widths.
    """
    flights, generator = 304, np.random.default_rng(2014)
    parameters = nominal_parameters(flights)
    for name, half_width in {
        "atmosphere.density": 0.10,
        "aero.lift": 0.10,
        "aero.drag": 0.15,
    }.items():
        parameters[:, PARAMETER_INDEX[name]] += generator.uniform(-half_width, half_width, flights)
    coarse = make_flight_plan("s_manoeuvre", "ghame_x")
    fine = make_flight_plan(
        {"base": "s_manoeuvre", "step": f"{0.5 * coarse.timing.step} s"}, "ghame_x"
    )
    coarse_block, fine_block = (fly(plan, parameters) for plan in (coarse, fine))
    flown = f"tlc, {flights} flights"
    changed = float((coarse_block.outcome != fine_block.outcome).sum())
    spread, change = (
        np.std(fine_block.metrics, axis=0),
        np.abs(coarse_block.metrics - fine_block.metrics).max(axis=0),
    )
    share = np.divide(change, spread, out=change.copy(), where=spread > 0.0)
    check(
        [
            Row("half the step", flown, "outcomes that change", "-", changed, 0.0),
            *(
                Row("half the step", flown, metric.name, "of its spread", float(value), 0.01)
                for metric, value in zip(METRICS, share, strict=True)
            ),
        ]
    )
