"""Shared code of the studies: the paper's dispersions, and flights with changing gains."""

import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.flights.blocks import FlightBlock
from abhv_mc_vehicle.control.controller_file import Controller, TlcController, read_controller
from abhv_mc_vehicle.control.design.tlc_design import make_tlc_gains, make_tlc_settings
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

ROOT = Path(__file__).parents[1]
Floats = NDArray[np.float64]

# Zhu and Shen 2014, section 7: uniform, half widths.
DISPERSIONS = {"atmosphere.density": 0.10, "aero.lift": 0.10, "aero.drag": 0.15}
CORNERS = (
    (1, 1, 1),
    (1, -1, -1),
    (-1, 1, -1),
    (-1, -1, 1),
)  # of density, lift and drag; four of the eight corners of the box

ERRORS = (
    "altitude_error_rms_m",
    "speed_error_rms_mps",
    "heading_error_rms_deg",
    "angle_of_attack_error_rms_deg",
    "bank_error_rms_deg",
    "sideslip_rms_deg",
)
FOLLOWING = (
    "angle_of_attack_error_rms_deg",
    "sideslip_rms_deg",
    "bank_error_rms_deg",
)  # angles of the paper's claim
USAGE = tuple(
    f"{surface}_{kind}_deg"
    for surface in ("aileron", "elevator", "rudder")
    for kind in ("rms", "travel")
)
ALLOWED = 1.05  # times TLC's usage


def corner_parameters() -> Floats:
    """Return the nominal flight and CORNERS, ``[flight, parameter]``."""
    parameters = nominal_parameters(1 + len(CORNERS))
    for row, corner in zip(parameters[1:], CORNERS, strict=True):
        for (name, half_width), sign in zip(DISPERSIONS.items(), corner, strict=True):
            row[PARAMETER_INDEX[name]] += sign * half_width
    return parameters


def random_parameters(flights: int, seed: int = 2014) -> Floats:
    """Draw the paper's dispersions, ``[flight, parameter]``."""
    generator = np.random.default_rng(seed)
    parameters = nominal_parameters(flights)
    for name, half_width in DISPERSIONS.items():
        parameters[:, PARAMETER_INDEX[name]] += generator.uniform(-half_width, half_width, flights)
    return parameters


def columns(block: FlightBlock, names: tuple[str, ...]) -> Floats:
    """Return metrics ``[flight, name]``."""
    return block.metrics[:, [METRIC_INDEX[name] for name in names]]


def wrapped(line: str) -> str:
    """Wrap a paragraph or list entry at 120 columns; tables, images and titles are unchanged."""
    if line.startswith(("|", "!", "#", ">")):
        return line
    wrapped_lines = textwrap.wrap(
        line.replace(" %", "\N{NO-BREAK SPACE}%"),  # MyST hides a line that starts with %
        120,
        subsequent_indent="  " if line.startswith("- ") else "",
        break_on_hyphens=False,
    )
    return "\n".join(wrapped_lines).replace("\N{NO-BREAK SPACE}%", " %")


class Bench:
    """Vehicle and mission for flights with changing gains of TLC."""

    def __init__(self, vehicle: Path, mission: Path) -> None:
        self.vehicle, self.mission = load_vehicle(vehicle), read_mission(mission)
        controller = read_controller(ROOT / "configs/control/tlc.yaml")
        if not isinstance(controller, TlcController):
            raise SystemExit("tlc.yaml is not a TLC controller")
        self.table_1 = controller
        self.plan = self.make_plan(controller)

    def make_plan(self, controller: Controller) -> FlightPlan:
        """Return the plan of any controller."""
        return make_plan(self.vehicle, self.mission, controller, controller.law)

    def fly_tlc(
        self, controller: TlcController, parameters: Floats, record_every: int | None = None
    ) -> FlightBlock:
        """Run flights of TLC with other gains."""
        gains = make_tlc_gains(controller, self.plan.reference, self.vehicle, self.plan.trim_tables)
        plan = replace(self.plan, gains=gains, settings=make_tlc_settings(controller, self.vehicle))
        return fly(plan, parameters, record_every)
