"""Preparation and checks of a campaign's flight plans, and sentences on how flights end.

The checks include dispersions of components that a vehicle does not have. The sentences name the
first quantity that is not finite.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, check_user_code
from abhv_mc.campaign.file.feasibility import refuse_input, values_of
from abhv_mc.custom_code.child import in_child
from abhv_mc.custom_code.source import read_source
from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.metrics import pack_metrics
from abhv_mc.flights.outcomes import SENTENCES, Outcome
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.design.reference import COLUMN_INDEX
from abhv_mc_vehicle.control.law_file import USER_LAWS
from abhv_mc_vehicle.flight.arguments import make_results
from abhv_mc_vehicle.flight.channels import CHANNELS, REFERENCE_CHANNELS
from abhv_mc_vehicle.flight.fly import fly_in_memory, nominal_parameters
from abhv_mc_vehicle.flight.plan import SENSOR_TIMES, FlightPlan, find_invalid_sensor_time
from abhv_mc_vehicle.flight.user_law import compile_plan_channels
from abhv_mc_vehicle.kernel.flight.interface import LANES, make_memory
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import COLUMNS, SLACK
from abhv_mc_vehicle.kernel.plant.vehicle import (
    AXES,
    COEFFICIENTS,
    FIXED_TABLE_ROWS,
    MEMBER,
    PARAMETER_INDEX,
    Vehicle,
)
from abhv_mc_vehicle.plant.parameters import DISTURBANCES
from abhv_mc_vehicle.user_code.effector_commands import find_driven
from abhv_mc_vehicle.user_code.module import check_closure
from abhv_mc_vehicle.vehicle.actuators import axis_limits, drive, name_effectors, surface_list
from abhv_mc_vehicle.vehicle.shared_keys import (
    IN_WIND,
    STILL_AIR,
    describe_sensing,
    oscillation_conflict,
)
from abhv_mc_vehicle.vehicle_simulator.user_metrics import pack_sources

_NORTH = 0.95  # cosine of a heading near the jump from 360 to 0 deg
_AXIS_FAILURES = tuple(f"failure.{axis}." for axis in AXES)


def make_plans(
    campaign: Experiment,
    names: Iterable[str],
    prepare: Callable[[Path, Path, Path, str], FlightPlan],
) -> dict[str, FlightPlan]:
    """Return the plans of the named controllers. Raise InputError if an input is invalid."""
    model = campaign.model
    check_user_code(campaign)
    prepared = {
        name: prepare(model.vehicle, model.mission, model.controllers[name], name) for name in names
    }
    plans = {name: declare(campaign, plan) for name, plan in prepared.items()}
    for plan in plans.values():
        _check_dispersions(campaign, plan)
        if plan.channels_source is not None:
            compile_plan_channels(plan, LANES)  # Errors occur before any file is written.
    return plans


def _check_dispersions(campaign: Experiment, plan: FlightPlan) -> None:
    """Raise InputError, with location, for dispersions that a plan cannot simulate.

    The function rejects sensor delays, lags and intervals that are out of range with a probability
    above 1e-6; gusts, turbulence and noise if oscillations are limited; and failures of axes if
    effectors have actuators or are commanded directly.
    """
    for name in (name for name in (*SENSOR_TIMES, MEMBER) if name in campaign.varied):
        drawn = values_of(campaign, name)
        rows = nominal_parameters(drawn.size)
        rows[:, PARAMETER_INDEX[name]] = drawn
        if invalid := _find_invalid(plan, rows):
            raise refuse_input(campaign, name, *invalid)
    moving = [name for name in DISTURBANCES if name in campaign.varied]
    if conflict := oscillation_conflict(plan.limits.loads, moving):
        raise refuse_input(campaign, moving[0], conflict, STILL_AIR)
    failing = [name for name in campaign.varied if name.startswith(_AXIS_FAILURES)]
    if failing and plan.vehicle.constants.driven:
        problem = (
            f"'{failing[0]}' refers to an axis, but '{plan.controller}' has actuators at the "
            "effectors"
        )
        names = ", ".join(name_effectors(plan.vehicle))
        raise refuse_input(campaign, failing[0], problem, f"a failure of an effector: {names}")


def check_rows(plan: FlightPlan, parameters: Floats) -> None:
    """Raise InputError for rows [flight, parameter] that a plan cannot simulate."""
    if invalid := _find_invalid(plan, parameters):
        raise InputError("dispersions", *invalid)
    moving = [name for name in DISTURBANCES if parameters[:, PARAMETER_INDEX[name]].any()]
    if conflict := oscillation_conflict(plan.limits.loads, moving):
        raise InputError("dispersions", conflict, STILL_AIR)


def _find_invalid(plan: FlightPlan, parameters: Floats) -> tuple[str, str] | None:
    """Return an invalid sensor time or member of the ensemble and its range, or None."""
    members = parameters[:, PARAMETER_INDEX[MEMBER]]
    count = plan.members
    wrong = members[(members % 1.0 != 0.0) | (members < 0.0) | (members > count)]
    if wrong.size:
        expected = f"a whole number from 0 to {count}" if count else "a mission with an ensemble"
        return f"'{MEMBER}' is {wrong[0]:g}", expected
    return find_invalid_sensor_time(parameters, plan.timing.tick)


def declare(campaign: Experiment, plan: FlightPlan) -> FlightPlan:
    """Return the plan with the metrics, channels and actuators of the campaign.

    Plan files do not contain these settings. All controllers of a campaign use the same actuators.
    """
    if find_driven(campaign.model.vehicle, campaign.model.controllers.values()):
        plan = replace(plan, vehicle=drive(plan.vehicle), settings=plan.settings.copy())
        if (
            plan.commanding_law not in USER_LAWS
        ):  # Built-in control laws limit axis commands even if the effectors have the actuators.
            limits = axis_limits(plan.vehicle)
            plan.settings[-limits.size :] = limits
    if campaign.model.channels is not None:
        channels = read_source(campaign.model.channels)
        check_closure(channels)
        plan = replace(plan, channels_source=channels, channels_hash=channels.hash)
    return declare_metrics(campaign, plan)


def declare_metrics(campaign: Experiment, plan: FlightPlan) -> FlightPlan:
    """Return the plan with the campaign's metrics, specialized to its varied parameters."""
    contents = campaign.contents
    declared = pack_metrics(contents.declared)
    sources = pack_sources(contents.user_sources)
    laws = [name for name in campaign.parameters.index if name.startswith("law.")]
    return replace(
        plan,
        declared=declared,
        user_sources=sources,
        law_parameters=np.array(laws, np.str_),
    ).lean_for(campaign.varied)


def find_warnings(plans: Mapping[str, FlightPlan], campaign: Experiment) -> list[str]:
    """Return warnings about the mission and sensing, without duplicates."""
    plain = [warning for plan in plans.values() for warning in plan.warnings.tolist()]
    specific = *_sensing(plans, campaign), *_find_jumps(plans, campaign)
    return list(dict.fromkeys([*specific, *plain]))


def _find_jumps(plans: Mapping[str, FlightPlan], campaign: Experiment) -> Iterable[str]:
    """Yield a warning for each metric of a heading that jumps, because flights head north."""
    headings = next(iter(plans.values())).reference[:, COLUMN_INDEX["heading"]]
    for metric in campaign.metrics.values() if np.cos(headings).max() > _NORTH else ():
        if re.search(r"^(?!.*(sin|cos)\().*\bheading_(measured_)?deg\b", metric.of):
            yield f"metric '{metric.name}' jumps by 360 deg at north; heading_error_deg does not"


def _sensing(plans: Mapping[str, FlightPlan], campaign: Experiment) -> list[str]:
    """Return a list with a sentence on the reference of measurements; empty without wind."""
    plan = next(iter(plans.values()))
    windy = any(name.startswith("wind.") for name in campaign.varied) or plan.profile[:, 1:3].any()
    return [f"{IN_WIND} {describe_sensing(plan.vehicle.constants.sensing)}"] if windy else []


def reference_of(plan: FlightPlan, stride: int) -> dict[str, Floats]:
    """Return the reference trajectory: ``time`` (s) and REFERENCE_CHANNELS, each [time].

    Only every ``stride``-th control tick is returned.
    """
    reference = plan.reference[::stride]
    columns: dict[str, Floats] = {
        "time": np.arange(float(len(reference))) * (stride * plan.timing.tick)
    }
    for signal in REFERENCE_CHANNELS:
        column = reference[:, COLUMN_INDEX[signal.name.partition("_reference")[0]]]
        columns[signal.name] = (
            np.degrees(column) if signal.unit == "deg" else np.ascontiguousarray(column)
        )
    return columns


def find_lacking(campaign: Experiment, vehicle: Vehicle) -> list[InputError]:
    """Return errors for dispersions of components that the vehicle does not have."""
    expected = "a dispersion that affects this vehicle"
    return [
        refuse_input(
            campaign,
            name,
            f"'{name}' refers to a component that the vehicle does not have",
            expected,
        )
        for name in campaign.varied
        if not _has(vehicle, name)
    ]


def _has(vehicle: Vehicle, name: str) -> bool:
    """Return whether a parameter can affect the vehicle.

    The only parameters without an effect are factors on components that the vehicle does not have.
    """
    group, _, suffix = name.partition(".")
    if (vehicle.foreign.aerodynamics and group == "aero") or (
        vehicle.foreign.propulsion and group == "propulsion"
    ):
        return True
    if group == "aero" and not suffix.endswith(".increment"):
        coefficient, _, variable = suffix.partition(".")
        if variable:
            return bool(np.any(vehicle.build_up.factor == PARAMETER_INDEX[name]))
        return bool(np.any(vehicle.build_up.coefficient == COEFFICIENTS.index(coefficient)))
    if effector := re.match(r"effector_(\d+)", suffix):
        return int(effector[1]) < len(vehicle.effector_mix)
    if group in ("actuator", "engine") and suffix in SLACK:
        places = surface_list(vehicle)[-1:] if group == "engine" else surface_list(vehicle)[:-1]
        return bool(vehicle.actuators[places, COLUMNS.index(suffix)].any())
    if group == "engine":
        return vehicle.constants.equivalence_ratio_max > 0.0
    thrust = "capture_area_ratio", "thrust_area"
    rows: dict[str, tuple[str, ...]] = {
        "propulsion.thrust": thrust,
        "propulsion.specific_impulse": thrust,
    }
    rows["mass.inertia_13"] = ("inertia_13",)
    return name not in rows or any(np.any(_values(vehicle, row)) for row in rows[name])


def _values(vehicle: Vehicle, row: str) -> np.ndarray:
    """Return the values of one of the FIXED_TABLE_ROWS at all nodes of its table."""
    tables = vehicle.tables
    number = int(tables.fixed_row[FIXED_TABLE_ROWS.index(row)])
    group = int(np.searchsorted(tables.group_row, number, side="right")) - 1
    stop = np.append(tables.group_start, tables.data.size)[group + 1]
    block = tables.data[tables.group_start[group] : stop].reshape(-1, tables.group_width[group])
    values: np.ndarray = block[:, number - tables.group_row[group]]
    return values


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
    recording = Recording(1, tuple(range(len(CHANNELS))))
    memory = make_memory(LANES)
    results = make_results(plan, 1, recording, False)
    fly_in_memory(plan, parameters, results, recording, memory)
    end = int(results.end_tick[0])
    lane = memory.Z[:, 0]
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
