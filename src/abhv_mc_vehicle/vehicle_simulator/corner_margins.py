"""Stability margins of flights, and of the initial trim at extreme parameter values.

Plans compute the margins of flights; margins of dispersed trims need no flight.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.interfaces import TrimMargins
from abhv_mc.io.messages import InputError
from abhv_mc.process_settings import one_blas_thread
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.stability.fly_with_margins import MarginPlan, add_margins

if TYPE_CHECKING:  # Workers do not import this module.
    from abhv_mc.campaign.file.experiment import Experiment

Margins = tuple[
    Floats, list[str]
]  # margins [flight, margin] in the order of MARGIN_NAMES, and reasons for missing ones
_LOOKED_AT = 1000  # number of flights whose sensor intervals are checked


def make_margin_plans(
    campaign: "Experiment", plans: Mapping[str, FlightPlan]
) -> dict[str, MarginPlan]:
    """Return plans that compute stability margins; empty if no margins are requested.

    Raise InputError if margins cannot be computed.
    """
    model = campaign.model
    if model.margins is None:
        return {}

    from abhv_mc_vehicle.stability.linearize import repeats_after, sensor_ticks
    from abhv_mc_vehicle.stability.point_slopes import find_period

    if not _can_trim(plans):
        raise InputError(
            model.vehicle,
            "stability margins require control surfaces and an engine",
            "a vehicle with both",
        )
    sampled = campaign.rows(campaign.make_samples().draw(0, min(campaign.runs, _LOOKED_AT)))
    margin_plans = {}
    for name, plan in plans.items():
        steady = make_steady(campaign, plan, model.controllers[name])
        period = find_period(
            steady
        ).ticks  # Control laws without a period are rejected before any simulation.
        for ticks in np.unique(sensor_ticks(steady, sampled), axis=0):
            repeats_after(ticks, period)
        margin_plans[name] = add_margins(plan, steady, model.margins.at)
    return margin_plans


def _can_trim(plans: Mapping[str, FlightPlan]) -> bool:
    """Return whether the vehicle has control surfaces and an engine."""
    constants = next(iter(plans.values())).vehicle.constants
    return constants.surface_limit != 0.0 and constants.equivalence_ratio_max != 0.0


def make_steady(campaign: "Experiment", plan: FlightPlan, controller: Path) -> FlightPlan:
    """Return the plan of steady flight at the start of the mission.

    Raise InputError if there is no trim.
    """
    from abhv_mc_vehicle.control.controller_file import read_controller
    from abhv_mc_vehicle.control.mission import read_mission
    from abhv_mc_vehicle.flight.prepare import user_law_of
    from abhv_mc_vehicle.stability.steady import make_steady_plan

    law = read_controller(controller)
    mission = read_mission(campaign.model.mission)
    steady = make_steady_plan(
        plan.vehicle, mission, law, plan.controller, user_code=user_law_of(plan, law)
    )
    return steady.lean_for(campaign.varied)


def trim_margins(campaign: "Experiment", controllers: Sequence[str]) -> dict[str, TrimMargins]:
    """Return, for each controller, a function that computes margins of dispersed trims.

    Its argument is an array of rows [flight, parameter]; no flight is simulated. Raise InputError
    if margins cannot be computed.
    """
    from abhv_mc_vehicle.vehicle_simulator.campaign_file import MarginsOfFlights

    model = campaign.model.model_copy(update={"margins": MarginsOfFlights()})
    changed = replace(campaign, model=model)
    margin_plans = make_margin_plans(changed, changed.simulator.make_plans(controllers))
    return {name: partial(_margins_of, plan) for name, plan in margin_plans.items()}


def _margins_of(plan: Any, rows: Floats) -> Margins:
    from abhv_mc_vehicle.stability.analysis import margins_of_flights

    flight_margins = margins_of_flights(plan, plan.steady, rows, ("trim",))
    return flight_margins.table, flight_margins.faults[0]


# maximum number of parameters for which all corners are computed, and number of random corners that
# are computed if there are more parameters
_ALL_CORNERS = 6
_SOME = 64
_DIGITS = 6


def make_corners(campaign: "Experiment") -> Floats:
    """Return parameter rows: nominal values, then corners of the ranges of dispersions."""
    from abhv_mc.campaign.sampling.samples import full_rows

    count = len(campaign.names)
    ends = np.array([campaign.ends_of(i)[[0, 2]] for i in range(count)]).reshape(count, 2)
    if count <= _ALL_CORNERS:
        sides = np.array(list(product((0, 1), repeat=count)), int)
    else:
        sides = np.random.default_rng(campaign.model.seed).integers(0, 2, (_SOME, count))
    values = ends[np.arange(count), sides]
    nominal = campaign.parameters.nominal[None]
    parameters = campaign.parameters
    return (
        np.vstack([nominal, full_rows(campaign.names, values, campaign.derived, parameters)])
        if count
        else nominal
    )


@one_blas_thread()
def describe_stability(campaign: "Experiment", plans: Mapping[str, FlightPlan]) -> dict[str, Any]:
    """Return the content of ``margins.json``: nominal margins, and minimum margins at corners.

    ``plans`` include the code of custom control laws. If a controller has no trim or margins, the
    result contains the reason. The result is empty for vehicles without control surfaces or engine.
    """
    if not _can_trim(plans):
        return {}
    rows = make_corners(campaign)
    controllers = {}
    for name, file in campaign.model.controllers.items():
        try:
            controllers[name] = _describe(name, make_steady(campaign, plans[name], file), rows)
        except InputError as error:
            controllers[name] = {"fault": error.found}
        except (
            Exception
        ) as error:  # An error must not stop the campaign, whose flights are complete.
            controllers[name] = {"fault": f"not computed ({type(error).__name__}: {error})"}
    has_all_corners = len(rows) == 1 + 2 ** len(campaign.names)
    return {"corners": len(rows) - 1, "all_corners": has_all_corners, "controllers": controllers}


def _describe(name: str, steady: Any, parameters: Floats) -> dict[str, Any]:
    from abhv_mc_vehicle.stability.analysis import NO_SLOPES, analyse, make_rows
    from abhv_mc_vehicle.stability.linearize import linearize
    from abhv_mc_vehicle.stability.probe import compile_probes
    from abhv_mc_vehicle.stability.steady import trim_points

    # Computing the trims may require the compiled probes.
    compile_probes(steady)
    points = trim_points(steady, parameters)
    if points.faults[0]:
        return {"fault": points.faults[0]}
    stability = analyse(linearize(steady, points.points), apart=True)
    if not stability.poles[0].size:
        return {"fault": NO_SLOPES}
    table = [make_rows(name, None, stability, i) for i in range(len(parameters))]
    corners = zip(table[1:], stability.poles[1:], points.faults[1:], strict=True)
    trimmed = [rows for rows, poles, fault in corners if poles.size and not fault]
    stable = [rows for rows in trimmed if rows[-1]["stable"]]
    return {
        "nominal": [_rounded(row) for row in table[0]],
        "corners_without_trim": len(table) - 1 - len(trimmed),
        "corners_unstable": len(trimmed) - len(stable),
        "corners": [_least([rows[i] for rows in stable]) for i in range(len(table[0]))]
        if stable
        else [],
    }


def _least(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the smallest margins of one loop over all corners, with None if unlimited."""
    least = {"loop": rows[0]["loop"]}
    for key in rows[0]:
        if key.endswith(
            (
                "_margin_deg",
                "_margin_ms",
                "_high_db",
                "disk_margin",
                "disk_gain_db",
                "disk_phase_deg",
            )
        ):
            least[key] = min((row[key] for row in rows if row[key] is not None), default=None)
        elif key.endswith("_low_db"):
            least[key] = max((row[key] for row in rows if row[key] is not None), default=None)
    return _rounded(least)


def _rounded(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with its numbers rounded to the number of digits in reports."""
    return {k: float(f"{v:.{_DIGITS}g}") if isinstance(v, float) else v for k, v in row.items()}


def is_compiled() -> bool:
    """Return whether compiled code for margins is cached on this machine."""
    from abhv_mc_vehicle.kernel.jit import is_cached
    from abhv_mc_vehicle.kernel.stability.structured import LAST_COMPILED

    return is_cached(LAST_COMPILED)
