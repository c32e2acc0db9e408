"""Sentences on how a flight ended, which name the first quantity that is not finite."""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import in_child
from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.outcomes import SENTENCES, Outcome
from abhv_mc_vehicle.flight.arguments import make_results
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.fly import fly_in_memory
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.flight.memory import make_memory
from abhv_mc_vehicle.kernel.plant import state as s

_NEVER = "stagnation_heat_flux_w_m2"  # channel that is NaN if the vehicle has no nose radius
_ORDER = sorted(
    range(len(CHANNELS)), key=lambda i: "measured" not in CHANNELS[i].name
)  # Measured values come first, because control laws use them.


def describe_end(plan: FlightPlan, parameters: Floats, outcome: Outcome) -> str:
    """Return sentences about the end of a flight; re-run the flight if the cause is unknown.

    ``parameters`` is the flight's row [1, parameter].
    """
    if outcome != Outcome.NOT_FINITE:
        return SENTENCES[outcome]
    quantity = (
        in_child(_find, plan, parameters) if plan.must_run_in_child else _find(plan, parameters)
    )
    return f"{SENTENCES[outcome]} The first non-finite quantity was the {quantity}."


def _find(plan: FlightPlan, parameters: Floats) -> str:
    """Return the first quantity of a flight that is not finite, with its time."""
    recording, memory = Recording(1, tuple(range(len(CHANNELS)))), make_memory(LANES)
    results = make_results(plan, 1, recording, False)
    fly_in_memory(plan, parameters, results, recording, memory)
    end, lane = int(results.end_tick[0]), memory.Z[:, 0]
    commands = [
        name for i, name in enumerate(plan.effectors) if np.isnan(lane[s.EFFECTOR_COMMAND + i])
    ]
    for tick in range(max(end - 1, 0), end + 1):
        row = results.history[0, tick]
        if np.isfinite(row).any():  # Rows without any finite value were not recorded.
            broken = [
                CHANNELS[i]
                for i in _ORDER
                if not np.isfinite(row[i]) and CHANNELS[i].name != _NEVER
            ]
            if broken and not (
                commands and broken[0].source.startswith("cmd_")
            ):  # Axis commands are sums over all effectors and do not show which effector is NaN.
                return f"{broken[0].doc} ({broken[0].name}) at {tick * plan.timing.tick:g} s"
    states = [name for name, value in zip(s.STATES, lane, strict=False) if not np.isfinite(value)]
    description = (
        f"command of the effector {commands[0]}" if commands else f"state {', '.join(states[:1])}"
    )
    return f"{description} at {end * plan.timing.tick:g} s"
