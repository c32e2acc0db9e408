"""Flights stepped from outside equal the flights of a law inside, bit for bit."""

import numpy as np
import pandas as pd
import pytest

import abhv_mc
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.fly import fly

LAW = """
from typing import NamedTuple
from abhv_mc.extend import Command, controller

class Memory(NamedTuple):
    total: float = 0.01

@controller
def law(measured, memory):
    total = memory.total + 1e-3 * measured.acceleration_z
    elevator = -0.015 - 0.4 * (measured.angle_of_attack - 0.048) + 1e-3 * total
    aileron = -0.05 * measured.bank - 0.1 * measured.roll_rate
    command = Command(aileron, -0.2 * measured.sideslip, elevator, 0.85, bank=0.1 * measured.yaw)
    return command, Memory(total)
"""
COMMANDS = ("aileron", "rudder", "elevator", "equivalence_ratio", "bank")
DISPERSIONS = {
    "aero.lift": {"distribution": "uniform", "half_width": "10 %"},
    "wind.turbulence": {"distribution": "uniform", "low": "0 m/s", "high": "3 m/s"},
    "sensor.angle_of_attack_noise": {"distribution": "uniform", "low": "0 deg", "high": "0.1 deg"},
    "sensor.delay": {"distribution": "uniform", "low": "0 ms", "high": "30 ms"},
    "failure.engine.time": {"distribution": "uniform", "low": "0.2 s", "high": "2 s"},
}


def outside(measured, total):
    """Return the commands of LAW, and its new memory."""
    total = total + 1e-3 * measured["acceleration_z"]
    elevator = -0.015 - 0.4 * (measured["angle_of_attack"] - 0.048) + 1e-3 * total
    aileron = -0.05 * measured["bank"] - 0.1 * measured["roll_rate"]
    rows = aileron, -0.2 * measured["sideslip"], elevator, 0.85 + 0.0 * total
    return np.nan_to_num(np.column_stack([*rows, 0.1 * measured["yaw"]])), total


def code(number):
    return Outcome(number).code


def inside(tmp_path, study):
    (tmp_path / "law.py").write_text(LAW)
    (tmp_path / "law.yaml").write_text("law: python\nfile: law.py\n")
    study = {"name": "inside", "controllers": {"law": str(tmp_path / "law.yaml")}, **study}
    campaign = abhv_mc.Campaign.make(study)  # its folder exists as long as the object
    experiment = read_campaign(campaign.path)
    plan = experiment.simulator.make_plans(["law"])["law"]
    samples = experiment.make_samples()
    rows = samples.draw(0, experiment.runs)
    return plan, fly(plan, experiment.rows(rows), 1), pd.DataFrame(rows, columns=samples.names)


BACKLASH = {
    "bandwidth": "50 rad/s",
    "damping": 0.7,
    "limit": "20 deg",
    "rate_limit": "400 deg/s",
    "backlash": "0.3 deg",
}
PHASES = [
    {"kind": "level", "length": "1 s"},
    {"kind": "turn", "heading_change": "0.2 deg", "length": "2 s"},
]


@pytest.mark.parametrize(
    ("vehicle", "mission"),
    [
        ({"base": "abhv", "surfaces": BACKLASH}, {}),
        ("winged_cone", {"manoeuvre": {"kind": "phases", "phases": PHASES}}),
        ("flexible", {}),  # with custom states
    ],
)
def test_a_law_outside_gives_the_flights_of_the_law_inside(tmp_path, vehicle, mission):
    # Some flights end at the lower altitude, while others continue.
    limits = {"duration": "4 s", "limits.altitude": ["19.999 km", "21 km"]}
    mission = {"base": "s_manoeuvre", **limits, **mission}
    study = {"mission": mission, "vehicle": vehicle, "runs": 35, "seed": 3}
    plan, block, rows = inside(tmp_path, study | {"dispersions": DISPERSIONS})
    assert 1 < np.unique(block.end_time).size < 36
    plant = abhv_mc.Plant(mission, vehicle, rows=rows, commands=COMMANDS)
    state, total, saved = plant.reset(), 0.01, None
    ticks = [*range(plan.timing.ticks + 1)]
    for tick in [*ticks[:300], *ticks[200:]]:  # 100 ticks are repeated
        if tick == 200:
            state, total = (plant.restore(saved[0]), saved[1]) if saved else (state, total)
            saved = plant.save(), total
        commands, total = outside(state.measured, total)
        state = plant.step(commands)
        flying = block.end_time >= (tick - 0.5) * plan.timing.tick
        for i, name in enumerate(plant.channels):
            recorded = state.recorded[name][flying], block.history[flying, tick, i]
            np.testing.assert_array_equal(*recorded, err_msg=f"{name} at tick {tick}")
    for i, metric in enumerate(plan.metrics):
        np.testing.assert_array_equal(plant.metrics[metric.name], block.metrics[:, i])
    assert list(state.outcome) == list(map(code, block.outcome))
    with pytest.raises(InputError, match="ended"):
        plant.step(commands)


def test_steps_of_several_ticks_moments_and_invalid_commands():
    by_seed = {"dispersions": {"aero.lift": DISPERSIONS["aero.lift"]}, "seed": 5}
    plants = [abhv_mc.Plant("level", flights=2, **by_seed) for _ in range(2)]
    coarse = plants[0].step(plants[0].nominal, ticks=7)
    for _ in range(7):
        fine = plants[1].step(dict(zip(plants[1].commands, plants[1].nominal, strict=True)))
    for name, values in fine.measured.items():
        np.testing.assert_array_equal(coarse.measured[name], values)
    assert plants[0].reset(6).time == 0.0
    assert plants[0].step(plants[0].nominal, ticks=7).measured["altitude"][0] != values[0]
    before = plants[0].save().rows
    for wrong in ([0.0], {"flap": 0.0}, {"rudder": np.nan}, {"rudder": "left"}, np.zeros((3, 4))):
        with pytest.raises(InputError, match="commands"):
            plants[0].step(wrong)
    np.testing.assert_array_equal(plants[0].save().rows, before)
    names = ("roll_moment", "pitch_moment", "yaw_moment", "throttle")
    plant = abhv_mc.Plant("level", flights=2, commands=names, channels=())
    measured = plant.step([[100.0, 0.0, 0.0, 0.85], [0.0, 0.0, 0.0, 0.85]], ticks=50).measured
    roll, pitch, yaw = (np.diff(measured[f"{axis}_rate"])[0] for axis in ("roll", "pitch", "yaw"))
    assert roll < -0.01
    assert max(abs(pitch), abs(yaw)) < 0.02 * abs(roll)
