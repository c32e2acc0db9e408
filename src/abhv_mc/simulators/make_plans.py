"""The plans that a campaign flies: made from its files, or taken from another folder."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.user_metrics import pack_sources
from abhv_mc.control.design.reference import COLUMN_INDEX
from abhv_mc.control.law_file import USER_LAWS
from abhv_mc.flight.channels import REFERENCE_CHANNELS
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.metrics import pack_metrics
from abhv_mc.flight.plan import SENSOR_TIMES, FlightPlan, find_late
from abhv_mc.io.documents import InputError
from abhv_mc.kernel.flight.interface import LANES
from abhv_mc.kernel.plant.parameter_names import AXES, PARAMETER_INDEX
from abhv_mc.plant.parameters import DISTURBANCES
from abhv_mc.simulators.campaign_code import check_user_code
from abhv_mc.simulators.feasibility import asked_in_vain, refuse_input, values_of
from abhv_mc.user_code.effector_commands import find_driven
from abhv_mc.user_code.module import check_closure
from abhv_mc.user_code.source import read_source
from abhv_mc.user_code.user_channels import compile_channels
from abhv_mc.vehicle.actuators import axis_limits, drive, name_effectors
from abhv_mc.vehicle.shared_keys import IN_WIND, STILL_AIR, describe_sensing, refuse_oscillation

_AXIS_FAILURES = tuple(f"failure.{axis}." for axis in AXES)


def make_plans(
    campaign: Experiment,
    names: Iterable[str],
    prepare: Callable[[Path, Path, Path, str], FlightPlan],
) -> dict[str, FlightPlan]:
    """The plans of some of a campaign's controllers, with what it declares. Raises InputError."""
    model = campaign.model
    check_user_code(campaign)
    made = {
        name: prepare(model.vehicle, model.mission, model.controllers[name], name) for name in names
    }
    plans = {name: declare(campaign, plan) for name, plan in made.items()}
    for plan in plans.values():
        _check_dispersions(campaign, plan)
        if plan.channels_source is not None:
            compile_channels(plan.channels_source, LANES)  # now, before anything is written
    return plans


def _check_dispersions(campaign: Experiment, plan: FlightPlan) -> None:
    """Raise InputError, at its place, for dispersions that this plan's flights cannot have.

    Delays, lags or intervals of sensors out of range by more than one in 1e6; a limit on oscillation where gusts,
    turbulence or noise swing the angles; failures of axes where effectors are driven or commanded.
    """
    for name in (name for name in SENSOR_TIMES if name in campaign.varied):
        drawn = values_of(campaign, name)
        rows = nominal_parameters(drawn.size)
        rows[:, PARAMETER_INDEX[name]] = drawn
        if late := find_late(rows, plan.timing.tick):
            raise refuse_input(campaign, name, *late)
    moving = [name for name in DISTURBANCES if name in campaign.varied]
    if refused := refuse_oscillation(plan.limits.loads, moving):
        raise refuse_input(campaign, moving[0], refused, STILL_AIR)
    failing = [name for name in campaign.varied if name.startswith(_AXIS_FAILURES)]
    if failing and plan.vehicle.constants.driven:
        found = f"'{failing[0]}', of an axis, where '{plan.controller}' moves effectors by actuators of their own"
        names = ", ".join(name_effectors(plan.vehicle))
        raise refuse_input(campaign, failing[0], found, f"a failure of an effector: {names}")


def check_rows(plan: FlightPlan, parameters: Floats) -> None:
    """Raise InputError for dispersions of these rows [flight, parameter] that this plan's flights cannot have."""
    if late := find_late(parameters, plan.timing.tick):
        raise InputError("dispersions", *late)
    moving = [name for name in DISTURBANCES if parameters[:, PARAMETER_INDEX[name]].any()]
    if refused := refuse_oscillation(plan.limits.loads, moving):
        raise InputError("dispersions", refused, STILL_AIR)


def declare(campaign: Experiment, plan: FlightPlan) -> FlightPlan:
    """The plan with the metrics and channels that the campaign itself declares: no file of plans holds them.

    All of its laws fly one list of actuators.
    """
    if find_driven(campaign.model.vehicle, campaign.model.controllers.values()):
        plan = replace(plan, vehicle=drive(plan.vehicle), settings=plan.settings.copy())
        if (
            plan.commanding_law not in USER_LAWS
        ):  # what the actuators of the effectors leave of each axis
            limits = axis_limits(plan.vehicle)
            plan.settings[-limits.size :] = limits
    if campaign.model.channels is not None:
        channels = read_source(campaign.model.channels)
        check_closure(channels)
        plan = replace(plan, channels_source=channels, channels_hash=channels.hash)
    return declare_metrics(campaign, plan)


def declare_metrics(campaign: Experiment, plan: FlightPlan) -> FlightPlan:
    """The plan with the metrics of this campaign, for what it varies."""
    declared, sources = pack_metrics(campaign.declared), pack_sources(campaign.user_sources)
    laws = [name for name in campaign.parameters.index if name.startswith("law.")]
    return replace(
        plan,
        declared=declared,
        user_sources=sources,
        law_parameters=np.array(laws, dtype=np.str_),
    ).lean_for(campaign.varied)


def find_warnings(plans: Mapping[str, FlightPlan], campaign: Experiment) -> list[str]:
    """What the plans say about their mission, and what of the campaign cannot come out, each sentence once."""
    plain = [warning for plan in plans.values() for warning in plan.warnings.tolist()]
    return list(dict.fromkeys([*_sensing(plans, campaign), *plain, *asked_in_vain(campaign)]))


def _sensing(plans: Mapping[str, FlightPlan], campaign: Experiment) -> list[str]:
    """Where there is wind, what the instruments measure."""
    plan = next(iter(plans.values()))
    windy = any(name.startswith("wind.") for name in campaign.varied) or plan.profile[:, 1:3].any()
    return [f"{IN_WIND} {describe_sensing(plan.vehicle.constants.sensing)}"] if windy else []


def reference_of(plan: FlightPlan, stride: int) -> dict[str, Floats]:
    """The mission's reference: ``time`` and REFERENCE_CHANNELS, each [time] in its unit, every ``stride``-th tick."""
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
