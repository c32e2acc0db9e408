"""Flights of TLC with parameters that differ from Table 1, for studies/tune_tlc.py."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ERRORS, ROOT, Bench, Floats, columns, corner_parameters
from numpy.typing import NDArray

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.control.controller_file import TlcController
from abhv_mc_vehicle.control.design.profile import ramp_times
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX

INNER = tuple(f"attitude.{name}" for name in ("angle_of_attack", "sideslip", "bank")) + tuple(
    f"rates.{name}" for name in ("roll_rate", "pitch_rate", "yaw_rate")
)
OUTER = ("altitude", *(f"velocity.{name}" for name in ("flight_path_angle", "heading", "speed")))
FACTORS = (1.0 / 3.0, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
SWING, MANY = 0.5, 6  # deg; Table 1 has 5 on the nominal vehicle, from the step and the return
NOISE = 0.01  # deg and deg/s: rms of the white noise on each measured angle and body rate
NOISY = [
    f"sensor.{name}_noise"
    for name in (
        *("flight_path_angle", "heading", "angle_of_attack", "sideslip", "bank"),
        *("roll_rate", "pitch_rate", "yaw_rate"),
    )
]
SURFACES = ("aileron", "rudder", "elevator")
SHOWN = (*ERRORS, "aileron_travel_deg", "rudder_travel_deg", "elevator_travel_deg")
HEADS = (
    "altitude m",
    "speed m/s",
    "heading deg",
    "alpha deg",
    "bank deg",
    "beta deg",
    "aileron",
    "rudder",
    "elevator",
)


class Tuning:
    """Flights of TLC with parameters that differ from Table 1."""

    def __init__(self, vehicle: Path) -> None:
        mission = ROOT / "configs/mission/s_manoeuvre.yaml"
        self.bench, self.parameters = Bench(vehicle, mission), corner_parameters()
        self.steps = [first for first, _ in ramp_times(self.bench.mission)]

    def controller(self, changes: dict[str, float]) -> TlcController:
        """Return Table 1 with changes, such as 'attitude.bank.damping'."""
        data: dict[str, Any] = self.bench.table_1.model_dump(mode="json")
        for path, value in changes.items():
            *keys, last = path.split(".")
            node = data
            for key in keys:
                node = node[key]
            node[last] = value if last == "damping" else f"{value!r} rad/s"
        return TlcController.model_validate_json(json.dumps(data))

    def fly(self, changes: dict[str, float]) -> tuple[Floats, int] | None:
        """Return means of SHOWN and the most swings of a surface; None after an early termination.

        Swings are counted between two steps.
        """
        block = self.bench.fly_tlc(self.controller(changes), self.parameters, record_every=2)
        if (block.outcome != Outcome.OK).any():
            return None
        first, second = (np.searchsorted(block.times, step - 1e-9) for step in self.steps)
        surfaces = [CHANNEL_INDEX[f"{surface}_deg"] for surface in SURFACES]
        most = max(
            count_swings(values)
            for flight in block.history[:, first:second, surfaces]
            for values in flight.T
        )
        return columns(block, SHOWN).mean(axis=0), most

    def noisy_travel(self, changes: dict[str, float]) -> float:
        """Return the total travel of all surfaces in a nominal flight with NOISE, deg.

        Return NaN if the flight terminates early.
        """
        parameters = nominal_parameters()
        parameters[0, [PARAMETER_INDEX[name] for name in NOISY]] = np.deg2rad(NOISE)
        block = self.bench.fly_tlc(self.controller(changes), parameters)
        travel = columns(block, tuple(f"{surface}_travel_deg" for surface in SURFACES))
        return float(travel.sum()) if block.outcome[0] == Outcome.OK else float("nan")

    def overshoot(self, changes: dict[str, float]) -> float:
        """Return the overshoot of the nominal bank over its command after the first step, deg."""
        block = self.bench.fly_tlc(self.controller(changes), self.parameters[:1], record_every=1)
        early = block.times < 8.0
        bank, command = (
            block.history[0, early, CHANNEL_INDEX[name]].astype(np.float64)
            for name in ("bank_deg", "bank_command_deg")
        )
        return float(np.abs(bank).max() - np.abs(command).max())


def count_swings(values: NDArray[np.float32]) -> int:
    """Return how often a curve reverses by more than SWING."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(values)))) + 1
    count, way = 0, 0
    low = high = float(values[0])
    for value in [*values[turns].tolist(), float(values[-1])]:
        low, high = min(low, value), max(high, value)
        if (way >= 0 and high - value > SWING) or (way <= 0 and value - low > SWING):
            way = -1 if high - value > SWING and way >= 0 else 1
            low = high = value
            count += 1
    return count


def bandwidth_of(tuning: Tuning, channel: str) -> float:
    """Return a bandwidth of Table 1 or of a differentiator, rad/s."""
    value: Any = tuning.bench.table_1
    for key in channel.split("."):
        value = getattr(value, key)
    return float(value if channel.startswith("differentiators") else value.bandwidth)


def crossover_of(tuning: Tuning, channel: str) -> float:
    """Return twice the product of damping and bandwidth of Table 1, rad/s."""
    value: Any = tuning.bench.table_1
    for key in channel.split("."):
        value = getattr(value, key)
    return 2.0 * float(value.damping) * float(value.bandwidth)


def key_of(channel: str) -> str:
    """Return the key of a bandwidth in the controller file."""
    return channel if channel.startswith("differentiators") else f"{channel}.bandwidth"
