"""Tests of the benchmark of speed: its record, counted operations, and C++ twin."""

import shutil

import numpy as np
import pytest

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import RATE_LIMIT
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from benchmarks.counted import COUNTS
from benchmarks.operations import count_operations
from benchmarks.peers.twin import compile_twin, fly_twin
from benchmarks.speed import (
    make_work,
    read_operations,
)


def test_the_stored_counts_are_up_to_date():
    COUNTS.clear()
    assert count_operations(make_work(1)[0]) == read_operations(), (
        "count again: python -m benchmarks.operations"
    )


FLIGHTS = 4
FACTOR = 0.03
SLOW = 0.1
HALF_WIDTH = {
    "m": 0.02,
    "m/s": 3.0,
    "1/s": 1e-4,
    "rad": 0.002,
    "rad/s": 0.001,
}  # of what adds, by unit
# m, m/s, rad, kg over 60 s: rounding and libm; 2e-10 found. Promised are 1e-6 m of altitude.
AGREEMENT = 1e-8


def disperse():
    """Draw all dispersions of the twin; the surfaces of the last flight reach their rate limit."""
    generator = np.random.default_rng(5)
    parameters = nominal_parameters(FLIGHTS)
    for i, parameter in enumerate(PARAMETERS[: PARAMETER_INDEX["sensor.yaw_rate_bias"] + 1]):
        width = HALF_WIDTH.get(parameter.unit, FACTOR if parameter.nominal else 2e-4)
        parameters[:, i] += generator.uniform(-width, width, FLIGHTS)
    parameters[:, PARAMETER_INDEX["one"]] = 1.0
    parameters[-1, PARAMETER_INDEX["actuator.rate_limit"]] = SLOW
    return parameters


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_the_twin_simulates_the_same_flights_and_rejects_unsupported_dispersions(tmp_path):
    """Speeds are comparable only if the flights agree."""
    twin, plan = (
        compile_twin(tmp_path),
        make_flight_plan("s_manoeuvre", "ghame_x", controller="lqr"),
    )
    parameters = disperse()
    ours = fly(plan, parameters, record_every=1, keep_states=True)
    assert ours.outcome.tolist() == [Outcome.OK] * FLIGHTS
    limit = SLOW * plan.vehicle.actuators[0, RATE_LIMIT]
    assert np.abs(ours.states[-1, :, s.AILERON_RATE]).max() == pytest.approx(limit, rel=1e-12)
    _, states = fly_twin(twin, plan, parameters, ours.states[:, 0], keep=FLIGHTS)
    assert np.abs(states - ours.states).max() < AGREEMENT
    parameters[0, PARAMETER_INDEX["wind.turbulence"]] = 1.0
    with pytest.raises(ValueError, match=r"wind\.turbulence"):
        fly_twin(twin, plan, parameters, ours.states[:, 0])
