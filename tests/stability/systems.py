"""Systems that the tests of the stability layer share."""

from functools import cache

import numpy as np

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.prepare import make_plan
from abhv_mc.plant import state as s
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.analysis import analyse
from abhv_mc.stability.linearize import linearise
from abhv_mc.stability.points import make_steady_plan, trim_points
from abhv_mc.stability.probe import replay_law


def read(controller, mission="level", vehicle="ghame_x"):
    configs = shipped_configs()
    return (
        load_vehicle(configs / "vehicle" / f"{vehicle}.yaml"),
        read_mission(configs / "mission" / f"{mission}.yaml"),
        read_controller(configs / "control" / f"{controller}.yaml"),
    )


@cache
def steady_plan(controller, bank=0.0):
    return make_steady_plan(*read(controller), controller, bank)


@cache
def flight_plan(controller, duration=60.0):
    vehicle, mission, law = read(controller)
    return make_plan(vehicle, mission.model_copy(update={"duration": duration}), law, controller)


def parameters(flights=1, **values):
    found = nominal_parameters(flights)
    for name, value in values.items():
        found[:, PARAMETER_INDEX[name.replace("__", ".")]] = value
    return found


@cache
def linear_at_trim(controller, delay=0.0):
    plan, dispersions = steady_plan(controller), parameters(sensor__delay=delay)
    found = trim_points(plan, dispersions)
    assert found.faults == [""]
    return linearise(plan, dispersions, found.points)


@cache
def stability_at_trim(controller):
    return analyse(linear_at_trim(controller), 1000)


def decibels(gain):
    with np.errstate(divide="ignore"):
        return 20.0 * np.log10(gain)


def differences(plan, dispersions, tick, states):
    """What tells two flights apart, in the order of the closed loop's states."""
    delay = round(dispersions[0, s.parameter_row("sensor.delay") - s.P] / plan.timing.tick)
    now = states[:, tick]
    _, memory = replay_law(plan, dispersions, states, tick)
    actuators = now[:, [14, 17, 15, 18, 16, 19, 20, 21]]
    old = [path.make_path(states[:, tick - age]) for age in range(1, delay + 1)]
    everything = np.hstack([path.make_path(now), actuators, memory, *old])
    return everything[1] - everything[0]
