"""Fuel: what is burnt, by whom, and what a thrust dispersion does to it."""

import numpy as np
import pytest

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import prepare
from abhv_mc.plant import state as s
from abhv_mc.plant.parameters import PARAMETER_INDEX


def level(repository, vehicle):
    configs = repository / "configs"
    return prepare(vehicle, configs / "mission/level.yaml", configs / "control/tlc.yaml", "tlc")


def test_without_an_empty_mass_the_engine_runs_and_the_mass_stays(repository, tmp_path):
    """It flew with its engine off, and nothing said so."""
    (tmp_path / "ghame").symlink_to(repository / "configs/vehicle/ghame")
    text = (repository / "configs/vehicle/ghame_x.yaml").read_text()
    file = tmp_path / "vehicle.yaml"
    file.write_text("\n".join(line for line in text.splitlines() if not line.strip().startswith("empty:")))
    plan = level(repository, file)
    block = fly(plan, nominal_parameters(), 100)
    assert block.outcome[0] == Outcome.OK
    assert np.ptp(block.history[0, :, CHANNEL_INDEX["mass_kg"]]) == 0.0
    assert block.metrics[0, METRIC_INDEX["fuel_used_kg"]] == 0.0
    assert block.metrics[0, METRIC_INDEX["speed_error_max_mps"]] < 1.0  # with its engine off it loses 20 m/s a second
    assert block.metrics[0, METRIC_INDEX["equivalence_ratio_min"]] > 0.9
    assert any("burns no fuel" in warning for warning in plan.warnings)


@pytest.mark.parametrize(("parameter", "ratio"), [("propulsion.thrust", 1.0), ("propulsion.specific_impulse", 1.05)])
def test_thrust_is_dispersed_at_the_same_fuel_flow(repository, parameter, ratio):
    """In the first control period the engine has not yet answered: both flights burn at the same equivalence ratio."""
    plan = level(repository, repository / "configs/vehicle/ghame_x.yaml")
    parameters = nominal_parameters(2)
    parameters[1, PARAMETER_INDEX[parameter]] = 1.05
    states = fly(plan, parameters, 1, keep_states=True).states
    nominal, dispersed = states[:, 0, s.MASS] - states[:, 1, s.MASS]
    assert nominal > 0.01  # kg in 10 ms
    assert nominal / dispersed == pytest.approx(ratio, rel=1e-5)
