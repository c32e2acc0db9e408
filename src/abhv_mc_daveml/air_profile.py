"""Air profile of a mission, computed from a DAVE-ML model of the atmosphere."""

import math
from collections.abc import Mapping

import numpy as np

from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.io.phrases import joined
from abhv_mc.io.units import KELVIN
from abhv_mc_daveml.adapters import Answer, factor_to_si, parse_answer, signed_factor
from abhv_mc_daveml.graph import Model, Variable
from abhv_mc_daveml.signals import find_signals
from abhv_mc_daveml.writer import make_function

ALTITUDES = np.arange(0.0, 80_001.0, 50.0)  # altitudes of the table in m
# specific gas constant of air in J/(kg K), as in the plant (U.S. Standard Atmosphere 1976)
_GAS_CONSTANT = 8314.32 / 28.9644
_CHOICES = ("density", "pressure"), ("pressure", "temperature"), ("density",)
_TEMPERATURES = {"dgk": "K", "dgc": "degC", "dgr": "degR", "dgf": "degF"}  # units of S-119


def write_air_profile(model: Model, answers: Mapping[str, Answer]) -> str:
    """Return a CSV table of density, or of pressure and temperature.

    The table has pressure and temperature if the model computes a pressure. Answers replace missing
    inputs. Raise InputError if one of these quantities is not positive at an altitude of the table.
    """
    function, inputs = make_function(model), dict[str, tuple[float, float]]()
    for variable in model.inputs:
        answer = answers.get(variable.identifier, variable.initial)
        if isinstance(answer, str) or answer is None:
            terms = parse_answer(model, variable, answer or "altitude", ())
            factor = factor_to_si(model, variable, "altitude")
            inputs[variable.key] = 0.0, sum(share for share, _ in terms) / factor
        else:
            inputs[variable.key] = float(answer), 0.0
    outputs = find_signals(model.outputs)
    quantities = next(names for names in _CHOICES if outputs.keys() >= set(names))
    scales = [_scale_of(model, outputs[name], name) for name in quantities]
    rows = []
    for altitude in ALTITUDES.tolist():
        result = function(**{key: a + b * altitude for key, (a, b) in inputs.items()})
        values = [
            getattr(result, outputs[name].key) * factor + offset
            for name, (factor, offset) in zip(quantities, scales, strict=True)
        ]
        if not all(0.0 < value < math.inf for value in values):
            problem = f"the {joined(list(quantities), 'or')} at {altitude:g} m is not positive"
            raise InputError(model.path, problem, f"positive values up to {ALTITUDES[-1]:g} m")
        if quantities == ("density", "pressure"):
            density, pressure = values
            values = [pressure, pressure / (density * _GAS_CONSTANT)]
        rows.append(",".join(map(repr, (altitude, *values))))
    columns = "density [kg/m3]" if len(quantities) == 1 else "pressure [Pa],temperature [K]"
    return "\n".join([f"altitude [m],{columns}", *rows]) + "\n"


def _scale_of(model: Model, variable: Variable, quantity: str) -> tuple[float, float]:
    """Return the factor and the offset from an output's unit to SI."""
    if quantity != "temperature":
        return signed_factor(model, variable, quantity), 0.0
    if variable.units.lower() not in _TEMPERATURES:
        problem = f"'{variable.identifier}', the temperature, has the unit '{variable.units}'"
        raise InputError(model.path, problem, one_of(_TEMPERATURES), variable.line)
    return KELVIN[_TEMPERATURES[variable.units.lower()]]
