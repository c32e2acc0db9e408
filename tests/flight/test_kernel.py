"""A flight does not depend on how it is flown: alone, abreast, in which order, beside what, lean or full, in Python."""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from short_flights import cut, short_plan

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.flight import fly as flying
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.kernel.flight.fly_lanes import COMPACTION, make_fly_lanes
from abhv_mc.kernel.flight.interface import LANES
from abhv_mc.kernel.flight.memory import TOGETHER
from abhv_mc.kernel.plant.parameter_names import FAILURE_TIMES, PARAMETER_INDEX
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.simulators.end_sentence import describe_end
from abhv_mc.simulators.engine import make_engine
from abhv_mc.simulators.make_plans import make_plans

FLIGHTS = LANES


FACTOR = 0.05


HALF_WIDTH = {"-": 2e-4, "m": 0.02, "m/s": 3.0, "1/s": 1e-4, "rad": 0.005, "rad/s": 0.001, "s": 0.02}  # what adds


NEVER_NEGATIVE = ("_noise", "turbulence", "delay", "gust_start")


@pytest.fixture(scope="module")
def plans():
    """Plans of two controllers over the first 3 s of the S manoeuvre: the bank steps at once."""
    return {name: short_plan(300, name, vehicle="ghame_x_coupled") for name in ("tlc", "lqr")}


@pytest.fixture(scope="module")
def dispersed():
    """Every parameter dispersed in every flight."""
    generator = np.random.default_rng(16)
    widths = [FACTOR if parameter.nominal else HALF_WIDTH[parameter.unit] for parameter in PARAMETERS]
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


def result(block):
    return (block.outcome, block.end_time, block.metrics, block.history, block.states)


def assert_equal(one, other, order=slice(None)):
    for mine, theirs in zip(one, other, strict=True):
        assert np.array_equal(mine[order], theirs, equal_nan=mine.dtype.kind == "f")


@pytest.mark.thorough  # a kernel of its own, for one flight
@pytest.mark.parametrize("law", ["tlc", "lqr"])
def test_one_at_a_time_is_abreast(plans, dispersed, law):
    abreast = fly(plans[law], dispersed, record_every=10, keep_states=True)
    alone = fly(plans[law], dispersed, record_every=10, keep_states=True, lanes=1)
    assert np.sum(abreast.outcome == Outcome.OK) > FLIGHTS // 2  # some failures end a flight
    assert len({row.tobytes() for row in abreast.metrics}) == FLIGHTS  # they really differ
    assert_equal(result(abreast), result(alone))


@pytest.mark.parametrize("law", ["tlc", "lqr"])
def test_packing_does_not_matter(plans, dispersed, law):
    together = result(fly(plans[law], dispersed, record_every=50, keep_states=True))
    order = np.random.default_rng(3).permutation(FLIGHTS)
    assert_equal(together, result(fly(plans[law], dispersed[order], 50, keep_states=True)), order)
    few = [11, 2, 7]  # spare lanes
    assert_equal(together, result(fly(plans[law], dispersed[few], 50, keep_states=True)), few)


@pytest.mark.parametrize("broken", [("atmosphere.density", np.nan), ("aero.lift", np.inf), ("mass.total", 0.0)])
def test_a_neighbour_that_breaks_does_not_matter(plans, dispersed, broken):
    healthy = result(fly(plans["tlc"], dispersed, record_every=50, keep_states=True))
    name, value = broken
    others = dispersed.copy()
    others[[0, 5, 15], PARAMETER_INDEX[name]] = value
    beside = fly(plans["tlc"], others, record_every=50, keep_states=True)
    ends = Outcome.FUEL_OUT if name == "mass.total" else Outcome.NOT_FINITE
    assert (beside.outcome[[0, 5, 15]] == ends).all()
    assert (beside.end_time[[0, 5, 15]] < 0.1).all()
    first = {"atmosphere.density": "dynamic pressure of the air (dynamic_pressure_pa) at 0 s", "aero.lift": "at 0"}
    assert first.get(name, "") in describe_end(plans["tlc"], others[:1], ends)
    kept = np.setdiff1d(np.arange(FLIGHTS), [0, 5, 15])
    assert_equal(healthy, tuple(values[kept] for values in result(beside)), kept)


def test_a_flight_does_not_see_the_one_before_it(plans, dispersed):
    # One flight more than lanes: the last starts in lanes that others have flown in, and one of those has broken down.
    wrecked = np.concatenate([dispersed, dispersed[:1]])
    wrecked[:FLIGHTS, PARAMETER_INDEX["atmosphere.density"]] = np.nan
    after = fly(plans["tlc"], wrecked, record_every=50, keep_states=True)
    fresh = fly(plans["tlc"], dispersed[:1], record_every=50, keep_states=True)
    assert_equal(result(after), result(fresh), slice(FLIGHTS, None))


PLAIN = """
import pickle, sys
from pathlib import Path
import numpy as np
import numba
assert numba.config.DISABLE_JIT
from abhv_mc.simulators.end_sentence import describe_end
from abhv_mc.flight.fly import fly
plans, parameters = pickle.loads(Path(sys.argv[1]).read_bytes())
for law, plan in plans.items():
    block = fly(plan, parameters, record_every=1, keep_states=True, lanes=1)
    np.savez(Path(sys.argv[1]).with_name(law), states=block.states, metrics=block.metrics, outcome=block.outcome)
"""


def test_plain_python_flies_the_same(plans, dispersed, tmp_path):
    ticks = 6
    short = {law: cut(plan, ticks) for law, plan in plans.items()}
    (tmp_path / "plans.pickle").write_bytes(pickle.dumps((short, dispersed)))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", PLAIN, str(tmp_path / "plans.pickle")], env=environment, check=True)
    for law, plan in short.items():
        compiled = fly(plan, dispersed, record_every=1, keep_states=True)
        plain = np.load(tmp_path / f"{law}.npz")
        assert np.array_equal(plain["states"], compiled.states)
        assert np.array_equal(plain["metrics"], compiled.metrics)
        assert np.array_equal(plain["outcome"], compiled.outcome)


@pytest.mark.thorough
def test_flights_that_take_the_lanes_of_ended_ones_stay_the_same():
    # Centres of gravity far enough aft end flights at many moments; more flights than close ranks together.
    plan = short_plan(3 * COMPACTION + 7, "lqr")
    parameters = nominal_parameters(TOGETHER + 45)
    errors = np.random.default_rng(3).uniform(-0.4, 0.4, len(parameters))
    parameters[:, PARAMETER_INDEX["mass.center_of_gravity_x"]] += errors
    abreast = fly(plan, parameters, record_every=50, keep_states=True)
    ended = abreast.end_time[abreast.outcome != Outcome.OK]
    segments = np.unique((ended / plan.timing.tick) // COMPACTION)
    assert 20 < len(ended) < len(parameters) - 20 and len(segments) >= 3
    assert_equal(result(abreast), result(fly(plan, parameters, record_every=50, lanes=1, keep_states=True)))


CAMPAIGNS = {  # which of them it flies
    "f16_gust": False,
    "failures": False,
    "harder_vehicle": True,
    "paper": True,
    "s_manoeuvre": True,
    "wide": True,
    "wind_and_air_data": False,
    "wind_and_sensors": False,
    "winged_cone": True,
}


QUICK = ("s_manoeuvre", "winged_cone", *(name for name, lean in CAMPAIGNS.items() if not lean))


SLOW = [pytest.param(name, marks=pytest.mark.thorough) for name in CAMPAIGNS if name not in QUICK]


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_lean_flights_have_the_same_bits(name, repository, monkeypatch):
    campaign = read_campaign(repository / "campaigns" / f"{name}.yaml", 64, None, None)
    plans = make_plans(campaign, campaign.model.controllers, make_engine())
    assert {plan.lean for plan in plans.values()} == {CAMPAIGNS[name]}
    source = campaign.make_samples()
    rows = full_rows(source.names, source.draw(0, 64), ())
    for plan in plans.values() if CAMPAIGNS[name] else ():
        blocks = []
        for lean in (True, False):
            monkeypatch.setattr(flying, "choose_flight", lambda lanes, _, lean=lean: make_fly_lanes(lanes, lean))
            blocks.append(flying.fly(plan, rows, 100))
        for part in ("outcome", "end_time", "metrics", "history"):
            assert np.array_equal(*(getattr(block, part) for block in blocks), equal_nan=True), (plan.controller, part)


def test_a_lean_flight_refuses_what_it_does_not_know(repository):
    campaign = read_campaign(repository / "campaigns" / "s_manoeuvre.yaml", 1, None, None)
    (plan, *_) = make_plans(campaign, ["tlc"], make_engine()).values()
    rows = full_rows(("wind.north",), np.array([[10.0]]), ())
    with pytest.raises(ValueError, match="lean"):
        flying.fly(plan, rows)
