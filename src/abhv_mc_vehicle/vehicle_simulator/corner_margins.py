"""Stability margins in the initial trim, at nominal and extreme parameter values."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.blas_threads import one_blas_thread
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.io.input_error import InputError
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.vehicle_simulator.margin_plans import make_steady

# maximum number of parameters for which all corners are computed, and number of random corners that
# are computed if there are more parameters
_ALL_CORNERS, _SOME = (
    6,
    64,
)
_DIGITS = 6


def make_corners(campaign: Experiment) -> Floats:
    """Return parameter rows: nominal values, then corners of the ranges of dispersions."""
    count = len(campaign.names)
    ends = np.array([campaign.ends_of(i)[[0, 2]] for i in range(count)]).reshape(count, 2)
    if count <= _ALL_CORNERS:
        sides = np.array(list(product((0, 1), repeat=count)), int)
    else:
        sides = np.random.default_rng(campaign.model.seed).integers(0, 2, (_SOME, count))
    values = ends[np.arange(count), sides]
    nominal, parameters = campaign.parameters.nominal[None], campaign.parameters
    return (
        np.vstack([nominal, full_rows(campaign.names, values, campaign.derived, parameters)])
        if count
        else nominal
    )


@one_blas_thread()
def describe_stability(campaign: Experiment, plans: Mapping[str, FlightPlan]) -> dict[str, Any]:
    """Return the content of ``margins.json``: nominal margins, and minimum margins at corners.

    ``plans`` include the code of custom control laws. If a controller has no trim or margins, the
    result contains the reason. The result is empty for vehicles without control surfaces or engine.
    """
    vehicle = next(iter(plans.values())).vehicle
    if vehicle.constants.surface_limit == 0.0 or vehicle.constants.equivalence_ratio_max == 0.0:
        return {}
    rows, controllers = make_corners(campaign), {}
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
    is_trimmed = [
        poles.size and not fault
        for poles, fault in zip(stability.poles, points.faults, strict=True)
    ]
    trimmed = [rows for rows, trim in zip(table[1:], is_trimmed[1:], strict=True) if trim]
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
    least: dict[str, Any] = {"loop": rows[0]["loop"]}
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
