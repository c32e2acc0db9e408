"""Uncertainties of DAVE-ML outputs as dispersions of a campaign."""

import json
from collections.abc import Sequence

from abhv_mc.io.messages import quoted
from abhv_mc_daveml.graph import Model, Uncertainty, Variable
from abhv_mc_daveml.signals import quantity_of, sign_of

_FACTORS = {
    "CL": "aero.lift",
    "CD": "aero.drag",
    "CY": "aero.side_force",
    "Cl": "aero.rolling_moment",
    "Cm": "aero.pitching_moment",
    "Cn": "aero.yawing_moment",
    "force_x": "propulsion.thrust",
    "mass": "mass.total",
    **{f"inertia_{axis}": f"mass.inertia_{axis}" for axis in ("xx", "yy", "zz")},
}
_INCREMENTS = {name: f"{_FACTORS[name]}.increment" for name in ("CL", "CD", "Cm")}


def write_dispersions(models: Sequence[Model]) -> str:
    """Return dispersions and correlations as YAML text; '' if there are no uncertainties.

    The text also lists the uncertainties that no campaign parameter represents.
    """
    stated = [(v, v.uncertainty) for model in models for v in model.outputs if v.uncertainty]
    entries = {v.identifier: entry for v, own in stated if (entry := _entry(v, own))}
    left = [
        key
        for model in models
        for key, variable in model.variables.items()
        if variable.uncertainty and key not in entries
    ]
    if not entries and not left:
        return ""
    lines = ["# Uncertainties of the files, to be copied into a campaign."]
    if left:
        lines.append(f"# No campaign parameter represents the uncertainty of {quoted(left, 'or')}.")
    lines += [
        f"dispersions:{'' if entries else ' {}'}",
        *(f"  {name}: {json.dumps(law)}" for name, law in entries.values()),
    ]
    # An additive uncertainty depends on the sign convention; a factor does not.
    signs = {
        v.identifier: sign_of(quantity_of(v) or "", v) or 1 if own.effect == "additive" else 1
        for v, own in stated
    }
    pairs = {
        tuple(sorted((entries[v.identifier][0], entries[other][0]))): coefficient
        * signs[v.identifier]
        * signs[other]
        for v, own in stated
        for other, coefficient in own.correlations
        if v.identifier in entries and other in entries
    }
    lines += ["correlations:"] if pairs else []
    lines += [
        f"  - {json.dumps({'between': pair, 'normal': coefficient})}"
        for pair, coefficient in pairs.items()
    ]
    return "\n".join(lines) + "\n"


def _entry(variable: Variable, own: Uncertainty) -> tuple[str, dict[str, str | float]] | None:
    """Return the campaign parameter and distribution of an uncertainty, or None."""
    quantity = quantity_of(variable) or ""
    names = _INCREMENTS if own.effect == "additive" else _FACTORS
    if own.half_width is None or own.effect == "absolute" or quantity not in names:
        return None
    width = own.half_width / (100.0 if own.effect == "percentage" else 1.0)
    if own.sigmas is None:
        return names[quantity], {"distribution": "uniform", "half_width": width}
    return names[quantity], {"distribution": "normal", "sigma": width / own.sigmas}
