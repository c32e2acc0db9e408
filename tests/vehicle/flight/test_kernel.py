"""Independence of a flight from lanes, order, neighbours, the lean kernel and compilation.

Types, shapes, order and alignment that compiled code relies on are checked before it is called.
"""

import os
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from short_flights import assert_same, cut, rows_of, short_plan

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.flight import fly as flying
from abhv_mc_vehicle.flight.arguments import make_kernel_plan
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.flight.fly_lanes import COMPACTION, make_fly_lanes
from abhv_mc_vehicle.kernel.flight.interface import LANES, TOGETHER
from abhv_mc_vehicle.kernel.plant.vehicle import FAILURE_TIMES, PARAMETER_INDEX
from abhv_mc_vehicle.plant.parameters import OURS, PARAMETERS
from abhv_mc_vehicle.vehicle_simulator.make_plans import describe_end

FLIGHTS = LANES
FACTOR = 0.05
HALF_WIDTH = {
    "-": 2e-4,
    "m": 0.02,
    "m/s": 3.0,
    "m/s2": 0.1,
    "K": 5.0,
    "1/s": 1e-4,
    "rad": 0.005,
    "rad/s": 0.001,
    "s": 0.02,
}  # what adds
NEVER_NEGATIVE = ("_noise", "turbulence", "delay", "gust_start")


@pytest.fixture(scope="module")
def plans():
    """Plans of two controllers over the first 3 s of the S manoeuvre, with its step in bank."""
    return {name: short_plan(300, name, vehicle="ghame_x_coupled") for name in ("tlc", "lqr")}


@pytest.fixture(scope="module")
def dispersed():
    """Every parameter dispersed in every flight."""
    generator = np.random.default_rng(16)
    widths = [
        FACTOR if parameter.nominal else HALF_WIDTH[parameter.unit] for parameter in PARAMETERS
    ]
    widths[PARAMETER_INDEX["one"]] = 0.0
    errors = generator.uniform(-1.0, 1.0, (FLIGHTS, len(PARAMETERS))) * widths
    for i, parameter in enumerate(PARAMETERS):
        if parameter.name.endswith(NEVER_NEGATIVE):
            errors[:, i] = 0.1 * np.abs(errors[:, i])
    parameters = nominal_parameters(FLIGHTS) + errors
    for name in FAILURE_TIMES:  # each failure in some flights, at any time
        fails = generator.uniform(size=FLIGHTS) < 0.2
        parameters[fails, PARAMETER_INDEX[name]] = generator.uniform(0.0, 3.0, FLIGHTS)[fails]
    return parameters


@pytest.mark.thorough  # a kernel of its own, for one flight
@pytest.mark.parametrize("law", ["tlc", "lqr"])
def test_one_at_a_time_is_abreast(plans, dispersed, law):
    abreast = fly(plans[law], dispersed, record_every=10, keep_states=True)
    alone = fly(plans[law], dispersed, record_every=10, keep_states=True, lanes=1)
    assert np.sum(abreast.outcome == Outcome.OK) > FLIGHTS // 2  # some failures end a flight
    assert len({row.tobytes() for row in abreast.metrics}) == FLIGHTS  # they really differ
    assert_same(abreast, alone)


@pytest.mark.parametrize("law", ["tlc", "lqr"])
def test_packing_does_not_matter(plans, dispersed, law):
    together = fly(plans[law], dispersed, 50, keep_states=True)
    order = np.random.default_rng(3).permutation(FLIGHTS)
    assert_same(together, fly(plans[law], dispersed[order], 50, keep_states=True), order)
    few = [11, 2, 7]  # spare lanes
    assert_same(together, fly(plans[law], dispersed[few], 50, keep_states=True), few)


@pytest.mark.parametrize(
    "broken", [("atmosphere.density", np.nan), ("aero.lift", np.inf), ("mass.total", 0.0)]
)
def test_a_neighbour_that_breaks_does_not_matter(plans, dispersed, broken):
    healthy = fly(plans["tlc"], dispersed, record_every=50, keep_states=True)
    name, value = broken
    changed = dispersed.copy()
    changed[[0, 5, 15], PARAMETER_INDEX[name]] = value
    neighbours = fly(plans["tlc"], changed, record_every=50, keep_states=True)
    ends = Outcome.FUEL_OUT if name == "mass.total" else Outcome.NOT_FINITE
    assert (neighbours.outcome[[0, 5, 15]] == ends).all()
    assert (neighbours.end_time[[0, 5, 15]] < 0.1).all()
    first = {
        "atmosphere.density": "dynamic pressure (dynamic_pressure_pa) at 0 s",
        "aero.lift": "at 0",
    }
    assert first.get(name, "") in describe_end(plans["tlc"], changed[:1], ends)
    healthy_rows = np.setdiff1d(np.arange(FLIGHTS), [0, 5, 15])
    for field in ("outcome", "end_time", "metrics", "history", "states"):
        np.testing.assert_array_equal(
            *(getattr(block, field)[healthy_rows] for block in (healthy, neighbours))
        )


def test_a_flight_does_not_see_the_one_before_it(plans, dispersed):
    # One flight more than lanes: the last starts in lanes that others have flown in, and one of
    # those has broken down.
    wrecked = np.concatenate([dispersed, dispersed[:1]])
    wrecked[:FLIGHTS, PARAMETER_INDEX["atmosphere.density"]] = np.nan
    after = fly(plans["tlc"], wrecked, record_every=50, keep_states=True)
    fresh = fly(plans["tlc"], dispersed[:1], record_every=50, keep_states=True)
    assert_same(after, fresh, slice(FLIGHTS, None))


PLAIN = """
import pickle, sys
from pathlib import Path
import numpy as np
import numba
assert numba.config.DISABLE_JIT
from abhv_mc_vehicle.flight.fly import fly
plans, parameters = pickle.loads(Path(sys.argv[1]).read_bytes())
for law, plan in plans.items():
    block = fly(plan, parameters, record_every=1, keep_states=True, lanes=1)
    np.savez(Path(sys.argv[1]).with_name(law), states=block.states, metrics=block.metrics, \
outcome=block.outcome)
"""


def test_plain_python_flies_the_same(plans, dispersed, tmp_path):
    short = {law: cut(plan, 6) for law, plan in plans.items()}
    (tmp_path / "plans.pickle").write_bytes(pickle.dumps((short, dispersed)))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run(
        [sys.executable, "-c", PLAIN, str(tmp_path / "plans.pickle")], env=environment, check=True
    )
    for law, plan in short.items():
        compiled = fly(plan, dispersed, record_every=1, keep_states=True)
        interpreted = np.load(tmp_path / f"{law}.npz")
        for field, values in interpreted.items():
            assert np.array_equal(values, getattr(compiled, field)), field


@pytest.mark.thorough
def test_flights_that_take_the_lanes_of_ended_ones_stay_the_same():
    # Centres of gravity far enough aft end flights at many moments; more flights than close ranks
    # together.
    plan = short_plan(3 * COMPACTION + 7, "lqr")
    parameters = nominal_parameters(TOGETHER + 45)
    errors = np.random.default_rng(3).uniform(-0.4, 0.4, len(parameters))
    parameters[:, PARAMETER_INDEX["mass.center_of_gravity_x"]] += errors
    abreast = fly(plan, parameters, record_every=50, keep_states=True)
    ended = abreast.end_time[abreast.outcome != Outcome.OK]
    segments = np.unique((ended / plan.timing.tick) // COMPACTION)
    assert 20 < len(ended) < len(parameters) - 20 and len(segments) >= 3
    assert_same(abreast, fly(plan, parameters, record_every=50, lanes=1, keep_states=True))


def campaign_plans(name, repository):
    campaign = read_campaign(repository / "campaigns" / f"{name}.yaml", 64, None, None)
    return campaign, campaign.simulator.make_plans(campaign.controllers).values()


SLOW = [
    pytest.param(name, marks=pytest.mark.thorough) for name in ("harder_vehicle", "paper", "wide")
]


@pytest.mark.parametrize("name", ["s_manoeuvre", "winged_cone", *SLOW])
def test_lean_flights_have_the_same_bits(name, repository, monkeypatch):
    campaign, plans = campaign_plans(name, repository)
    source = campaign.make_samples()
    rows = full_rows(source.names, source.draw(0, 64), (), OURS)
    for plan in plans:
        assert plan.lean
        blocks = []
        for lean in (True, False):
            monkeypatch.setattr(
                flying, "choose_flight", lambda lanes, _, lean=lean: make_fly_lanes(lanes, lean)
            )
            blocks.append(flying.fly(plan, rows, 100))
        assert_same(*blocks)


@pytest.mark.parametrize("name", ["f16_gust", "failures", "wind_and_air_data", "wind_and_sensors"])
def test_campaigns_with_wind_sensors_or_failures_use_the_full_kernel(name, repository):
    for plan in campaign_plans(name, repository)[1]:
        assert not plan.lean


def test_a_lean_flight_rejects_dispersed_wind(plans):
    lean = plans["tlc"].lean_for(["aero.lift"])
    with pytest.raises(ValueError, match="disperse"):
        flying.fly(lean, rows_of({"wind.north": 10.0}))


def misaligned(array):
    """Return a copy that starts at the second byte of its buffer."""
    buffer = bytearray(array.nbytes + 1)
    buffer[1:] = np.ascontiguousarray(array).tobytes()
    return np.frombuffer(buffer, array.dtype, array.size, 1).reshape(array.shape)


def spread_out(array):
    """Return a copy that is not contiguous: every other element of an array of twice the length."""
    return np.repeat(array, 2, axis=-1)[..., ::2]


@pytest.mark.parametrize("change", [misaligned, spread_out])
def test_the_kernel_gets_only_arrays_it_can_rely_on(plans, change):
    plan = plans["tlc"]
    tables = plan.vehicle.tables._replace(data=change(plan.vehicle.tables.data))
    changed = replace(plan, vehicle=plan.vehicle._replace(tables=tables), gains=change(plan.gains))
    kernel_plan = make_kernel_plan(changed, nominal_parameters(), Recording(0))
    for array, original in (
        (kernel_plan.vehicle.tables.data, plan.vehicle.tables.data),
        (kernel_plan.gains, plan.gains),
    ):
        assert array.flags.aligned and array.flags.c_contiguous and array.flags.writeable
        assert np.array_equal(array, original)


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (
            {"gains": np.zeros((301, 32), np.float32)},
            r"plan\.gains .*\bfloat32\b.*\bfloat64\b",
        ),
        ({"gains": np.zeros((301, 31))}, r"plan\.gains .*\(301, 31\).*\(any, 32\)"),
        ({"gains": np.zeros((300, 32))}, r"\b300 .* 0 to 300\b"),
        (
            {"initial_state": np.zeros((22, 1))},
            r"\binitial_state .*\(22, 1\).*\(22\)",
        ),
        ({}, r"\bparameters\b"),
    ],
)
def test_wrong_types_and_shapes_are_rejected(plans, change, pattern):
    parameters = nominal_parameters() if change else nominal_parameters()[:, 1:]
    with pytest.raises(ValueError, match=pattern):
        fly(replace(plans["tlc"], **change), parameters)
