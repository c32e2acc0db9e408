"""The C++ twin of the benchmark flies what we fly: its speed compares only because its flights agree."""

import shutil

import numpy as np
import pytest

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.one_flight.given import make_flight_plan
from abhv_mc.plant.parameters import PARAMETERS
from benchmarks.peers.twin import compile_twin, fly_twin

FLIGHTS = 4
FACTOR = 0.03
SLOW = 0.1
HALF_WIDTH = {"m": 0.02, "m/s": 3.0, "1/s": 1e-4, "rad": 0.002, "rad/s": 0.001}  # of what adds, by unit
AGREEMENT = 1e-8  # m, m/s, rad, kg over 60 s: rounding and libm; 2e-10 found. Promised are 1e-6 m of altitude.


@pytest.fixture(scope="module")
def plan():
    return make_flight_plan("s_manoeuvre", "ghame_x", controller="lqr")


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    if shutil.which("g++") is None:
        pytest.skip("no g++")
    return compile_twin(tmp_path_factory.mktemp("twin"))


def disperse():
    """Everything that the twin knows; the last flight's surfaces are slow enough to meet their rate limit."""
    generator = np.random.default_rng(5)
    parameters = nominal_parameters(FLIGHTS)
    for i, parameter in enumerate(PARAMETERS[: PARAMETER_INDEX["sensor.yaw_rate_bias"] + 1]):
        width = HALF_WIDTH.get(parameter.unit, FACTOR if parameter.nominal else 2e-4)
        parameters[:, i] += generator.uniform(-width, width, FLIGHTS)
    parameters[:, PARAMETER_INDEX["one"]] = 1.0
    parameters[-1, PARAMETER_INDEX["actuator.rate_limit"]] = SLOW
    return parameters


def test_the_twin_flies_the_same(plan, twin):
    parameters = disperse()
    ours = fly(plan, parameters, record_every=1, keep_states=True)
    assert ours.outcome.tolist() == [Outcome.OK] * FLIGHTS
    limit = SLOW * plan.vehicle.constants.surface_rate_limit
    assert np.abs(ours.states[-1, :, s.AILERON_RATE]).max() == pytest.approx(limit, rel=1e-12)
    _, states = fly_twin(twin, plan, parameters, ours.states[:, 0], keep=FLIGHTS)
    assert np.abs(states - ours.states).max() < AGREEMENT


def test_the_twin_refuses_what_it_does_not_know(plan, twin):
    parameters = nominal_parameters(1)
    parameters[0, PARAMETER_INDEX["wind.turbulence"]] = 1.0
    with pytest.raises(ValueError, match=r"wind\.turbulence"):
        fly_twin(twin, plan, parameters, plan.initial_state[np.newaxis])
