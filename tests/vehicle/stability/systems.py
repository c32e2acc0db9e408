"""Systems that the tests of the stability layer share."""

from functools import cache

import numpy as np

from abhv_mc.shipped import find_input, shipped_configs
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.flight.prepare import make_plan, read_law
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.stability.analysis import analyse
from abhv_mc_vehicle.stability.linearize import closed_loop, closed_period, linearize, sensor_states
from abhv_mc_vehicle.stability.points import flown_points, fly_disturbed
from abhv_mc_vehicle.stability.probe import law_memory_rows, plant_states
from abhv_mc_vehicle.stability.steady import make_steady_plan, trim_points
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle


def read(controller, mission="level", vehicle="ghame_x"):
    configs = shipped_configs()
    return (
        load_vehicle(configs / "vehicle" / f"{vehicle}.yaml"),
        read_mission(configs / "mission" / f"{mission}.yaml"),
        read_controller(find_input(controller, "control")),
    )


def plans_of(file, mission="level", vehicle="ghame_x", seconds=3.0):
    """The plan of a flight under a user's law, and that of steady flight."""
    craft, course, _ = read("lqr", mission, vehicle)
    law, code = read_law(file)
    short = course.model_copy(update={"duration": seconds})
    return tuple(
        make(craft, flight_mission, law, "own", user_code=code)
        for make, flight_mission in ((make_plan, short), (make_steady_plan, course))
    )


@cache
def steady_plan(controller, bank=0.0):
    return make_steady_plan(*read(controller), controller, bank)


@cache
def flight_plan(controller, duration=60.0):
    vehicle, mission, law = read(controller)
    return make_plan(vehicle, mission.model_copy(update={"duration": duration}), law, controller)


def parameters(flights=1, **values):
    rows = nominal_parameters(flights)
    for name, value in values.items():
        rows[:, PARAMETER_INDEX[name.replace("__", ".")]] = value
    return rows


@cache
def linear_at_trim(controller, delay=0.0):
    plan, dispersions = steady_plan(controller), parameters(sensor__delay=delay)
    trims = trim_points(plan, dispersions)
    assert trims.faults == [""]
    return linearize(plan, trims.points)


@cache
def stability_at_trim(controller):
    return analyse(linear_at_trim(controller), 1000)


def decibels(gain):
    with np.errstate(divide="ignore"):
        return 20.0 * np.log10(gain)


def assert_neutral(linear, margins):
    """With a loop's gain at either margin the closed loop has a pole on the unit circle."""
    span = linear.period * max(len(linear.phases), 1)
    assert np.isfinite(margins.gain_high[0]).any()
    for side in ("gain_low", "gain_high"):
        gains, frequencies = getattr(margins, side)[0], getattr(margins, f"{side}_frequency")[0]
        for i in np.flatnonzero(np.isfinite(frequencies)):
            scale = np.where(np.arange(len(gains)) == i, gains[i], 1.0)
            ticks = tuple(phase._replace(B=phase.B * scale) for phase in linear.phases or (linear,))
            poles = np.linalg.eigvals(closed_period(ticks[0]._replace(phases=ticks), 0))
            assert np.abs(poles - np.exp(1j * frequencies[i] * span)).min() < 1e-6


CHANGE = {
    "speed": 0.005,
    "angle_of_attack": 1e-6,
    "sideslip": 1e-6,
    "bank": 3e-6,
    "roll_rate": 1e-6,
    "pitch_rate": 1e-6,
}


def assert_predicted(plan, dispersions, first, ticks, every=1):
    """Compare the product of the ticks' linear maps with a full flight.

    The flight starts at the stored state; the tolerance is 0.2 % of each state's amplitude.
    """
    delay = round(dispersions[0, PARAMETER_INDEX["sensor.delay"]] / plan.timing.tick)
    states = plant_states(plan.vehicle)
    n, k = len(states), len(states) - 2
    change = np.zeros(n + len(law_memory_rows(plan)))
    change[[states.index(name) for name in CHANGE]] = list(CHANGE.values())
    flown = fly_disturbed(plan, dispersions, first, change, ticks)
    flown -= fly_disturbed(plan, dispersions, first, 0.0 * change, ticks)
    sensors = len(
        sensor_states(plan, flown_points(plan, dispersions, first * plan.timing.tick).points)
    )
    expected = np.concatenate([change, np.zeros(sensors + 10 * delay)])
    for tick in range(first, first + ticks, every):
        linear = linearize(
            plan, flown_points(plan, dispersions, (tick + every // 2) * plan.timing.tick).points
        )
        expected = np.linalg.matrix_power(closed_loop(linear, 0), every) @ expected
    scale = np.abs(flown).max(axis=0)[:n]
    scale[10:k:2], scale[11:k:2] = (
        scale[10:k:2].max(),
        scale[11:k:2].max(),
    )  # surfaces are compared with each other
    np.testing.assert_allclose(flown[-1, :n] / scale, expected[:n] / scale, rtol=0.0, atol=2e-3)
