"""Gain margins of laws of several rates against the growth of the difference of two flights 1e-7 apart."""

import numpy as np
import pytest
from stability.systems import decibels, parameters, read
from stability.test_periods import COUNTER, LAW, THREE

from abhv_mc.flight.fly import fly, fly_until
from abhv_mc.flight.prepare import read_law
from abhv_mc.kernel.plant import state as s
from abhv_mc.stability.analysis import analyse
from abhv_mc.stability.linearize import closed_period, linearize
from abhv_mc.stability.periods import find_period, go_on
from abhv_mc.stability.points import closed_states, disturb
from abhv_mc.stability.steady import make_steady_plan, trim_points

# The command of each control, of its deviation from the rest so many times as much.
SCALED = """\
    given, rest, factors = (aileron, rudder, elevator, eta), {rest}, {factors}
    return Command(*(u + k * (v - u) for u, k, v in zip(rest, factors, given))"""
BY_TIME = "throttle = round(time / dt) % 3 == 0"
WATCHED = (s.ROLL_RATE, s.YAW_RATE, s.PITCH_RATE, s.U)  # which state's difference grows with each loop


def plan_with(folder, rates, rest=(0.0,) * 4, factors=(1.0,) * 4):
    text = LAW.format(rates=rates)
    ours = SCALED.format(rest=rest, factors=factors)
    (folder / "law.py").write_text(text.replace("    return Command(aileron, rudder, elevator, eta", ours))
    (folder / "law.yaml").write_text("law: python\nfile: law.py\nrate: 100 Hz\n")
    vehicle, mission, _ = read("lqr")
    vehicle = vehicle._replace(constants=vehicle.constants._replace(burns_fuel=0.0))
    controller, user_code = read_law(folder / "law.yaml")
    return make_steady_plan(vehicle, mission, controller, "law", user_code=user_code)


def growth(folder, rates, points, loop, factor, frequency):
    """By how much the difference of two flights grows in a period of the law, from the mode of a frequency on."""
    factors = tuple(factor if i == loop else 1.0 for i in range(4))
    plan = plan_with(folder, rates, tuple(points.controls[0].tolist()), factors)
    period = find_period(plan).ticks
    values, vectors = np.linalg.eig(closed_period(linearize(plan, points), 0))
    mode = vectors[:, np.abs(values - np.exp(0.01j * period * frequency)).argmin()].real
    begin, ticks = period + 1, period * round(600 / period)
    long = go_on(plan, 0, begin + ticks)
    kept = fly_until(long, parameters(), begin)
    at = np.hstack([points.path[0], np.column_stack([points.controls[0], np.zeros(4)]).ravel(), points.memory[0]])
    change = at - closed_states(long, kept)
    flown = []
    for each in (0.0 * mode, 1e-7 * mode / np.abs(mode).max()):
        start = disturb(long, kept, change + each)
        flown.append(fly(long, parameters(), 1, keep_states=True, start=start).states[0, begin::period])
    d = (flown[1] - flown[0])[:, WATCHED[loop]]
    d = d[len(d) // 3 :]
    (a, b), *_ = np.linalg.lstsq(np.column_stack([d[1:-1], d[:-2]]), d[2:], rcond=None)
    return np.abs(np.roots([1.0, -a, -b])).max()


@pytest.mark.parametrize(
    "rates",
    [
        pytest.param(COUNTER, id="two"),
        pytest.param("throttle = round(time / dt) % 3 == 0", id="time", marks=pytest.mark.thorough),
        pytest.param(THREE, id="three", marks=pytest.mark.thorough),
    ],
)
def test_the_difference_of_two_flights_is_neutral_at_the_gain_margin(tmp_path, rates):
    plan = plan_with(tmp_path, rates)
    points = trim_points(plan, parameters()).points
    margins = analyse(linearize(plan, points)).margins
    found, frequencies = margins.gain_high[0], margins.gain_high_frequency[0]
    assert np.isfinite(found[[2, 3]]).all()
    for loop in np.flatnonzero(np.isfinite(found)):
        near = found[loop] * np.array([0.99, 1.01])
        sizes = np.log([growth(tmp_path, rates, points, loop, float(k), frequencies[loop]) for k in near])
        neutral = near[0] - sizes[0] * (near[1] - near[0]) / (sizes[1] - sizes[0])
        assert abs(decibels(neutral) - decibels(found[loop])) < (0.1 if loop == 3 else 0.02)
