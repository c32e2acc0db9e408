"""Fuel: what is burnt, by whom, and what a thrust dispersion does to it."""

import numpy as np
import pytest

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.one_flight.given import make_flight_plan


def test_without_an_empty_mass_the_engine_runs_and_the_mass_stays():
    """It flew with its engine off, and nothing said so."""
    plan = make_flight_plan("level", {"base": "ghame_x", "mass.empty": None})
    block = fly(plan, nominal_parameters(), 100)
    assert block.outcome[0] == Outcome.OK
    assert np.ptp(block.history[0, :, CHANNEL_INDEX["mass_kg"]]) == 0.0
    assert block.metrics[0, METRIC_INDEX["fuel_used_kg"]] == 0.0
    assert block.metrics[0, METRIC_INDEX["speed_error_max_mps"]] < 1.0  # with its engine off it loses 20 m/s a second
    assert block.metrics[0, METRIC_INDEX["equivalence_ratio_min"]] > 0.9
    assert any("burns no fuel" in warning for warning in plan.warnings)


@pytest.mark.parametrize(("parameter", "ratio"), [("propulsion.thrust", 1.0), ("propulsion.specific_impulse", 1.05)])
def test_thrust_is_dispersed_at_the_same_fuel_flow(parameter, ratio):
    """In the first control period the engine has not yet answered: both flights burn at the same equivalence ratio."""
    plan = make_flight_plan("level", "ghame_x")
    parameters = nominal_parameters(2)
    parameters[1, PARAMETER_INDEX[parameter]] = 1.05
    states = fly(plan, parameters, 1, keep_states=True).states
    nominal, dispersed = states[:, 0, s.MASS] - states[:, 1, s.MASS]
    assert nominal > 0.01  # kg in 10 ms
    assert nominal / dispersed == pytest.approx(ratio, rel=1e-5)
