"""Custom channels: what they are given of the truth and of a law's memory."""

import numpy as np
import pytest
from short_flights import cut

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import find_input
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.vehicle_simulator.make_plans import make_plans

# A memory of more numbers than numba takes in one call with choices, see
# abhv_mc_vehicle.user_code.compiled.
LAW = """\
from collections import namedtuple
from abhv_mc.extend import Command, controller

NAMES = ("ticks", *(f"number_{i}" for i in range(39)))
Memory = namedtuple("Memory", NAMES, defaults=[float(i) for i in range(40)])

@controller
def law(measured, reference, memory):
    numbers = (memory.ticks + 1.0,) + memory[1:]
    return Command(0.0, 0.0, reference.elevator, reference.equivalence_ratio), Memory(*numbers)
"""
CHANNELS = """\
from abhv_mc.extend import channel

@channel(unit="-")
def remembered(memory):
    return memory.ticks + 1000.0 * memory.number_38

@channel(unit="m/s2")
def felt(actual):
    return actual.acceleration_x ** 2 + actual.acceleration_y ** 2 + actual.acceleration_z ** 2

@channel(unit="rad")
def turned(actual):
    return actual.q0 * actual.q0 + actual.q1 * actual.q1 + actual.latitude + actual.longitude
"""


def make_plan(folder, controller="own.yaml"):
    (folder / "own.py").write_text(LAW, "utf-8")
    (folder / "own.yaml").write_text("law: python\nfile: own.py\n", "utf-8")
    (folder / "channels.py").write_text(CHANNELS, "utf-8")
    file = folder / "campaign.yaml"
    file.write_text(
        f"""name: own
question: What is remembered?
vehicle: {find_input("abhv", "vehicle")}
mission: {find_input("level", "mission")}
controllers: {{own: {controller}}}
runs: 3
dispersions:
  aero.lift: {{distribution: uniform, half_width: 5 %}}
channels: channels.py
metrics:
  remembered_end: {{of: remembered, statistic: final}}
  felt_end: {{of: felt, statistic: final}}
  turned_end: {{of: turned, statistic: final}}
""",
        "utf-8",
    )
    campaign = read_campaign(file)
    return make_plans(campaign, campaign.controllers, prepare)["own"]


def test_a_channel_has_the_truth_and_the_memory_after_the_tick(tmp_path):
    plan = cut(make_plan(tmp_path), 30)
    block = fly(plan, nominal_parameters(), 1, keep_states=True)
    names = [metric.name for metric in plan.metrics]
    remembered, felt, turned = (
        block.metrics[0, names.index(f"{name}_end")] for name in ("remembered", "felt", "turned")
    )
    assert remembered == 31.0 + 1000.0 * 39.0  # 31 ticks
    load = 9.80665 * block.history[0, -1, CHANNEL_INDEX["load_factor_g"]]
    assert np.sqrt(felt) == pytest.approx(load, rel=1e-6)
    x = block.states[0, -1]
    assert turned == pytest.approx(x[6] ** 2 + x[7] ** 2 + x[2] + x[1], rel=1e-12)


def test_a_channel_of_a_memory_that_a_controller_has_not_is_an_error_at_its_line(tmp_path):
    with pytest.raises(InputError, match=r"channels\.py:4: .*'remembered'.*'memory'"):
        make_plan(tmp_path, find_input("tlc", "control"))


def test_too_many_channels_are_an_error_at_their_line(tmp_path, monkeypatch):
    more = "".join(f'@channel(unit="m")\ndef c{i}(actual): return 1.0\n' for i in range(14))
    monkeypatch.setitem(globals(), "CHANNELS", CHANNELS + more)
    with pytest.raises(InputError, match=r"channels\.py:41: .*16"):
        make_plan(tmp_path)


def test_an_unknown_field_is_an_error_at_its_line(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "CHANNELS", CHANNELS.replace("memory.ticks", "memory.tickz"))
    with pytest.raises(InputError, match=r"channels\.py:5.*memory\.tickz"):
        make_plan(tmp_path)
