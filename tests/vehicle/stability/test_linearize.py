"""Tests of the linear model against compiled flights and an independent simulator."""

import re

import numpy as np
import pytest
from scipy.linalg import expm
from short_flights import short_plan
from vehicle.stability.systems import (
    assert_predicted,
    decibels,
    flight_plan,
    parameters,
    read,
    stability_at_trim,
    steady_plan,
)

from abhv_mc_vehicle.control.design.reference import make_mission_trim_tables
from abhv_mc_vehicle.control.design.trim_tables import LONGEST
from abhv_mc_vehicle.flight import prepare
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability import steady
from abhv_mc_vehicle.stability.analysis import analyse
from abhv_mc_vehicle.stability.linearize import actuator_matrices, linearize
from abhv_mc_vehicle.stability.probe import INPUTS, ask_plant
from abhv_mc_vehicle.stability.steady import make_steady_plan, trim_points

# An independent simulator: gain down and up (dB), phase (deg), delay (ms), sensitivity of each
# loop; None for none.
WORKED = {
    "tlc": {
        "aileron": (-1.31, 11.08, 20.7, 60.9, 6.18),
        "rudder": (-10.08, 0.82, 10.8, 54.9, 11.23),
        "elevator": (-28.97, 16.64, 63.8, 140.1, 1.28),
        "equivalence_ratio": (-42.17, 30.74, 81.3, 1460.4, 1.09),
    },
    "lqr_retuned_ghame_x": {
        "aileron": (-35.11, 5.65, 27.1, 17.7, 3.06),
        "rudder": (None, 5.55, 24.5, 15.9, 3.18),
        "elevator": (-58.99, 17.34, 50.9, 118.8, 1.30),
        "equivalence_ratio": (-70.81, 2.44, 9.4, 10.5, 7.37),
    },
}


def _assert_worked(margins, controller, loop):
    low, high, phase, delay, sensitivity = WORKED[controller][loop]
    i = INPUTS.index(loop)
    if low is None:
        assert margins.gain_low[0, i] == 0.0
    else:
        np.testing.assert_allclose(decibels(margins.gain_low)[0, i], low, atol=0.015)
    np.testing.assert_allclose(decibels(margins.gain_high)[0, i], high, atol=0.01)
    np.testing.assert_allclose(np.rad2deg(margins.phase[0, i]), phase, atol=0.06)
    np.testing.assert_allclose(1e3 * margins.delay[0, i], delay, atol=max(0.06, 8e-4 * delay))
    np.testing.assert_allclose(margins.sensitivity[0, i], sensitivity, atol=0.006)


@pytest.mark.parametrize(
    ("controller", "loop"),
    [
        (name, loop)
        for name, loops in WORKED.items()
        for loop in loops
        if (name, loop) != ("tlc", "equivalence_ratio")
    ],
)
def test_margins_are_those_of_an_independent_simulator(controller, loop):
    _assert_worked(stability_at_trim(controller).margins, controller, loop)


def test_tlcs_throttle_is_the_simulators_with_shorter_cells_of_its_trim_tables(monkeypatch):
    """Use short cells, as guidance takes secants over cells and the simulator slopes."""
    monkeypatch.setitem(LONGEST, "equivalence_ratio", 0.0625 / 32)
    for module in (steady, prepare):  # which keep what they found of the vehicle and mission
        monkeypatch.setattr(
            module, "make_mission_trim_tables", make_mission_trim_tables.__wrapped__
        )
    plan = make_steady_plan(*read("tlc"), "tlc")
    margins = analyse(linearize(plan, trim_points(plan, parameters()).points), 1000).margins
    _assert_worked(margins, "tlc", "equivalence_ratio")


@pytest.mark.parametrize(
    ("controller", "disk", "delay", "pole"),
    [("tlc", 0.0579, 87.0, -23.99 + 28.02j), ("lqr_retuned_ghame_x", 0.1408, 7.8, -1.09 + 16.3j)],
)
def test_all_loops_at_once_and_poles_are_those_of_an_independent_simulator(
    controller, disk, delay, pole
):
    analyses = stability_at_trim(controller)
    assert analyses.stable.all()
    np.testing.assert_allclose(analyses.margins.all_disk, disk, atol=6e-5)
    np.testing.assert_allclose(1e3 * analyses.margins.all_delay, delay, atol=0.06)
    nearest = analyses.poles[0][np.abs(analyses.poles[0] - pole).argmin()]
    assert abs(nearest - pole) < 0.035
    if controller == "tlc":
        slow = analyses.poles[0][np.abs(analyses.poles[0]) > 0.1]
        np.testing.assert_allclose(slow.real.max(), -0.181, atol=6e-4)


def test_the_papers_weights_do_not_stabilise_level_flight():
    stability = stability_at_trim("lqr")
    assert not stability.stable[0] and np.isnan(stability.margins.phase).all()
    np.testing.assert_allclose(stability.poles[0][0].real, 0.120, atol=6e-4)
    np.testing.assert_allclose(abs(stability.poles[0][0].imag), 2.78, atol=6e-3)


def test_the_trim_is_at_rest_on_the_turning_earth():
    plan, dispersions = steady_plan("tlc"), parameters(2, aero__lift=np.array([1.0, 0.95]))
    trims = trim_points(plan, dispersions)
    assert trims.faults == ["", ""]
    p = trims.points
    states = path.make_states(p.path, p.controls, p.latitude, p.mass)
    rates = ask_plant(plan, p.lane, 1, np.arange(2), states).rates
    np.testing.assert_allclose(path.path_rates(states, rates), 0.0, atol=1e-9)
    reference = plan.reference[0]
    # Not the reference's own trim, whose Earth is still.
    assert np.rad2deg(reference[8] - p.path[0, path.ALPHA]) == pytest.approx(0.033, abs=1e-3)
    assert np.rad2deg(reference[9] - p.path[0, path.BANK]) == pytest.approx(0.64, abs=0.01)
    assert p.path[1, path.ALPHA] > p.path[0, path.ALPHA]


def test_a_banked_trim_turns_as_its_reference_does():
    plan = steady_plan("tlc", np.deg2rad(46.0))
    trims = trim_points(plan, parameters())
    assert trims.faults == [""]
    assert np.rad2deg(plan.reference[0, 9]) == pytest.approx(46.0, abs=1e-6)
    states = path.make_states(*trims.points[:4])
    rates = path.path_rates(
        states, ask_plant(plan, trims.points.lane, 1, np.zeros(1, np.int64), states).rates
    )
    assert plan.reference[0, 7] == pytest.approx(9.8 / 1400.0, rel=0.1)
    np.testing.assert_allclose(rates[0, path.CHI], plan.reference[0, 7], atol=1e-10)


@pytest.mark.parametrize(
    ("controller", "delay"),
    [("tlc", 0.03), pytest.param("lqr", 0.02, marks=pytest.mark.thorough)],
)
def test_a_small_disturbance_flies_as_the_linear_model_says(controller, delay):
    # Without fuel flow: a difference of the throttle is one of the mass too, which is no state of
    # the model.
    dispersions = parameters(sensor__delay=delay, propulsion__specific_impulse=1e9)
    assert_predicted(flight_plan(controller, 3.0), dispersions, 100, 100, every=4)


NEUTRAL = [
    ("ghame_x", "level", "tlc", "aileron", "gain_low"),
    ("ghame_x", "level", "lqr_retuned_ghame_x", "aileron", "gain_high"),
    # TLC's slope over its last deflections is nothing here: steps of any size must stay in the
    # tables' cells.
    ("winged_cone", "level_mach15", "tlc", "rudder", "gain_low"),
]


@pytest.mark.parametrize(("vehicle", "mission", "controller", "surface", "side"), NEUTRAL)
def test_flights_begin_to_cycle_where_the_gain_margin_ends(
    vehicle, mission, controller, surface, side
):
    inputs = read(controller, mission, vehicle)
    steady = make_steady_plan(*inputs, controller)
    margins = analyse(linearize(steady, trim_points(steady, parameters()).points)).margins
    neutral = getattr(margins, side)[0, INPUTS.index(surface)]
    factors = neutral * np.array([0.97, 1.03])
    dispersions = parameters(
        2, initial__bank=np.deg2rad(0.01), **{f"control__{surface}_effectiveness": factors}
    )
    plan = make_plan(
        inputs[0], inputs[1].model_copy(update={"duration": 60.0}), inputs[2], controller
    )
    rate = fly(plan, dispersions, record_every=2).history[:, :, CHANNEL_INDEX["roll_rate_dps"]]
    early, late = np.ptp(rate[:, 250:500], axis=1), np.ptp(rate[:, 2500:], axis=1)
    np.testing.assert_array_equal(late > 0.5 * early, [side == "gain_low", side == "gain_high"])


def test_slopes_end_at_the_tables_nodes():
    """Beside a node and on either side of it, the slope is the cell's, not the mean over both."""
    plan, point = (
        steady_plan("lqr_retuned_ghame_x"),
        trim_points(steady_plan("lqr_retuned_ghame_x"), parameters()).points,
    )
    eta = np.array([1.0 - 1e-6, 1.0 + 1e-6, 1.0 - 1e-3, 1.0 + 1e-3])
    points = point._replace(
        **{
            name: np.repeat(getattr(point, name), 4, axis=0)
            for name in point._fields[:-1]  # but for the tick
        }
    )
    points.controls[:, 3] = eta
    thrust = linearize(plan, points).plant_B[:, 1, 3]
    np.testing.assert_allclose(thrust[:2], thrust[2:], rtol=1e-3)
    assert thrust[0] / thrust[1] > 1.02


def test_a_first_order_actuator_lags_and_its_rate_follows():
    bandwidth, tick = 30.0, 0.01
    surfaces = {"kind": "first_order", "bandwidth": "30 rad/s", "rate_limit": "4 rad/s"}
    surfaces |= {"limit": "20 deg", "dead_zone": "0.1 deg"}
    plan = short_plan(2, "lqr", "level", {"base": "ghame_x", "surfaces": surfaces})
    A, B = actuator_matrices(plan, np.ones((1, s.LAW)))
    whole = np.zeros((12, 12))
    whole[:8, :8], whole[:8, 8:] = A[0], B[0]
    end, kept = expm(tick * whole), np.exp(-bandwidth * tick)
    assert end[0, [0, 1, 8]] == pytest.approx([kept, 0.0, 1.0 - kept], abs=1e-12)
    assert end[1, [0, 1, 8]] == pytest.approx(bandwidth * np.array([-kept, 0.0, kept]), rel=1e-3)
    assert any(re.search("dead.zone .*aileron, rudder, elevator", x) for x in plan.warnings)
