"""Plans of shortened shipped missions, rows of parameters and comparison of blocks."""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from abhv_mc.shipped import find_input, shipped_configs
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan


def short_plan(
    ticks,
    controller="tlc",
    mission="s_manoeuvre",
    vehicle="ghame_x",
):
    """Return a plan of the first control ticks of a mission.

    Inputs are shipped names or paths; the vehicle can also be given by its changes.
    """
    vehicle = vehicle if isinstance(vehicle, Mapping) else str(vehicle)
    return cut(make_flight_plan(str(mission), vehicle, str(controller)), ticks)


def change_vehicle(folder, *changes, name="ghame_x"):
    """A shipped vehicle's file with other words; its tables stay where they are."""
    text = find_input(name, "vehicle").read_text("utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "vehicle.yaml"
    path.write_text(re.sub(r"file: (?=\w+/)", f"file: {shipped_configs()}/vehicle/", text), "utf-8")
    return path


def write_law(folder, text):
    """The file of a controller that is a user's law in Python, beside the law."""
    (folder / "law.py").write_text(text, "utf-8")
    (folder / "law.yaml").write_text("law: python\nfile: law.py\nrate: 100 Hz\n", "utf-8")
    return folder / "law.yaml"


def cut(plan, ticks):
    rows = {name: getattr(plan, name)[: ticks + 1] for name in ("reference", "gains")}
    return replace(plan, timing=plan.timing._replace(ticks=ticks), **rows)


def rows_of(*cases):
    """Parameters ``[flight, parameter]``: nominal but for what each flight's case names."""
    rows = nominal_parameters(len(cases))
    for row, case in zip(rows, cases, strict=True):
        for name, value in case.items():
            row[PARAMETER_INDEX[name]] = value
    return rows


def disperse(flights):
    """Return rows of which every third flight ends at the start, so that its lane is reused."""
    rows = nominal_parameters(flights)
    generator = np.random.default_rng(7)
    for name, width in (
        ("atmosphere.density", 0.1),
        ("aero.lift", 0.1),
        ("aero.pitching_moment", 0.1),
    ):
        rows[:, PARAMETER_INDEX[name]] += generator.uniform(-width, width, flights)
    rows[::3, PARAMETER_INDEX["initial.angle_of_attack"]] = 0.5  # rad, beyond its limit
    rows[:, PARAMETER_INDEX["initial.bank"]] += generator.uniform(-0.2, 0.2, flights)
    return rows


def assert_same(first, second, rows=slice(None)):
    """Assert that rows of one block equal another block."""
    for name in ("outcome", "end_time", "metrics", "history", "states"):
        assert np.array_equal(
            getattr(first, name)[rows], getattr(second, name), equal_nan=name != "outcome"
        ), name
