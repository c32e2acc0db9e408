"""Import of DAVE-ML files as Python functions, a vehicle file and the air of a mission.

The air profile is computed from a model of the atmosphere.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError, Refusal, found_value, joined, one_of, quoted
from abhv_mc.io.units import KELVIN
from abhv_mc.io.xml_reader import fold
from abhv_mc_daveml.adapters import (
    Answer,
    command_inputs,
    command_unit,
    factor_to_si,
    find_questions,
    frame_of,
    parse_answer,
    signed_factor,
    write_coefficients,
    write_law,
    write_thrust,
)
from abhv_mc_daveml.graph import Model, Variable, read_model
from abhv_mc_daveml.signals import find_signals, kinds_of, quantity_of
from abhv_mc_daveml.uncertainties import write_dispersions
from abhv_mc_daveml.writer import make_function, run_shots, write_module
from abhv_mc_vehicle.user_code.module_text import Line, write_text, write_unless_edited

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
    function = make_function(model)
    inputs = dict[str, tuple[float, float]]()
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
            raise InputError(
                model.path,
                f"the {joined(list(quantities), 'or')} at {altitude:g} m is not positive",
                f"positive values up to {ALTITUDES[-1]:g} m",
            )
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
        raise InputError(
            model.path,
            f"'{variable.identifier}', the temperature, has the unit '{variable.units}'",
            one_of(_TEMPERATURES),
            variable.line,
        )
    return KELVIN[_TEMPERATURES[variable.units.lower()]]


ANSWERS = "import.yaml"
EFFECTORS = "effectors"
Answers = dict[str, dict[str, Answer]]  # answers by file name and varID


@dataclass(frozen=True)
class Imported:
    """Result of an import: files written, and check shots."""

    paths: tuple[Path, ...]
    shots: Mapping[str, int]  # number of passed check shots, by file
    kept: tuple[Path, ...]  # edited files, next to which new versions are written


def import_daveml(files: Sequence[Path], folder: Path) -> Imported:
    """Import DAVE-ML files into a folder, after running all check shots.

    If a number is missing, the import stops and requests it in ``import.yaml`` in the folder. Raise
    InputError if a file is invalid.
    """
    models = [read_model(path) for path in files]
    for model in models:
        run_shots(model)
    questions = {model.path.name: find_questions(model) for model in models}
    values, effectors, is_given = _read_answers(folder / ANSWERS, models, questions)
    lines = [
        (
            "# Inputs that no signal of the program supplies: numbers in the units of the file, "
            "or sums of signals such as"
        ),
        (
            "# elevator + aileron. Custom surfaces: effectors: "
            "{left_flap: {elevator: 1, aileron: 1}}."
        ),
    ]
    if effectors:
        lines.append(f"{EFFECTORS}: {json.dumps(effectors)}")
    for name, variables in questions.items():
        lines += [f"{json.dumps(name, ensure_ascii=False)}:"] if variables else []
        for variable in variables:
            value = values[name][variable.identifier]
            line = (
                f"  {json.dumps(variable.identifier, ensure_ascii=False)}: "
                f"{'' if value is None else value}"
            )
            lines += [f"  # {variable.words}", line.rstrip()]
    texts = {} if is_given or not any(questions.values()) else {ANSWERS: "\n".join(lines) + "\n"}
    left = [
        f"{name}: {key}"
        for name, file_answers in values.items()
        for key, value in file_answers.items()
        if value is None
    ]
    if left:
        path = folder / ANSWERS
        if texts:
            folder.mkdir(parents=True, exist_ok=True)
            write_text(path, texts[ANSWERS])
        raise InputError(
            path,
            f"values are missing for {quoted(left)}",
            "values in this file (enter them and repeat the command)",
        )
    if texts:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / ANSWERS, texts[ANSWERS])
    paths, kept = write_unless_edited(folder, _write_parts(models, values, effectors))
    answers = (folder / ANSWERS,) if texts else ()
    shots = {model.path.name: len(model.shots) for model in models}
    return Imported((*answers, *paths), shots, kept)


def _read_answers(
    path: Path, models: Sequence[Model], questions: Mapping[str, Sequence[Variable]]
) -> tuple[Answers, dict[str, Any], bool]:
    """Return the answers, the custom effectors, and whether the answers are complete.

    Raise InputError if the file is invalid.
    """
    values: Answers = {
        name: {variable.identifier: variable.initial for variable in variables}
        for name, variables in questions.items()
    }
    if not path.exists():
        return values, {}, False
    document = read_document(path)
    answers: Any = document.data
    if not isinstance(answers, dict):
        raise document.error((), found_value(answers), "names of files with their missing inputs")
    effectors = answers.get(EFFECTORS, {})
    if not isinstance(effectors, dict) or not all(map(str.isidentifier, effectors)):
        raise document.error(
            (EFFECTORS,), found_value(effectors), "names of effectors with shares of each axis"
        )
    by_name = {model.path.name: model for model in models}
    for name, content in answers.items():
        if name == EFFECTORS:
            continue
        if name not in by_name:
            raise document.key_error(
                (name,), f"unknown name '{name}'", one_of((*by_name, EFFECTORS), name)
            )
        if not isinstance(content, dict):
            raise document.error(
                (name,), found_value(content), "names of signals with their values"
            )
        variables = {variable.identifier: variable for variable in questions[name]}
        for key, value in content.items():
            if key not in variables:
                raise document.key_error(
                    (name, key), f"unknown signal '{key}'", one_of(variables, key)
                )
            if isinstance(value, bool) or not isinstance(value, float | int | str | None):
                raise document.error(
                    (name, key),
                    found_value(value),
                    "a number in the units of the file, or a sum of signals",
                )
            if isinstance(value, str):
                try:
                    parse_answer(by_name[name], variables[key], value, effectors)
                except Refusal as refusal:
                    raise document.error((name, key), refusal.found, refusal.expected) from None
            values[name][key] = values[name][key] if value is None else value
    is_given = all(
        set(file_answers) <= set(answers.get(name) or {}) for name, file_answers in values.items()
    )
    return values, effectors, is_given


def _plain(text: str) -> str:
    """Return a name of letters, digits and underscores that begins with a letter."""
    plain = re.sub(r"\W", "_", text.lower(), flags=re.ASCII)
    return plain if plain[:1].isalpha() else f"x{plain}"


def _write_parts(
    models: Sequence[Model], answers: Answers, effectors: Mapping[str, Any]
) -> dict[str, str]:
    values = _constants(models, answers)
    span = values.get("span", 1.0)
    chord = values.get("chord", 1.0)
    texts: dict[str, str] = {}
    sections: dict[str, str] = {}
    for model in models:
        extra: list[Line] = []
        module = f"{_plain(model.path.stem)}.py"
        file_answers = answers[model.path.name]
        for kind in kinds_of(model):
            if kind == "aerodynamics":
                extra += write_coefficients(model, file_answers, span, chord, effectors)
                sections[kind] = (
                    f"  python: {module}\n  function: coefficients\n  frame: {frame_of(model)}"
                )
            elif kind == "propulsion":
                extra += write_thrust(model, file_answers)
                sections[kind] = (
                    f"  python: {module}\n  function: thrust\n  throttle: [0, 1]\n  ideal: true"
                )
            elif kind == "control":
                extra += write_law(model, file_answers)
                texts[f"{Path(module).stem}.yaml"] = _controller(model, module)
            elif kind == "atmosphere":
                texts[f"{Path(module).stem}.csv"] = write_air_profile(model, file_answers)
        texts[module] = write_module(model, extra)
    if "aerodynamics" in sections and "mass" in values:
        texts["vehicle.yaml"] = _vehicle(models, values, sections, effectors)
    if dispersions := write_dispersions(models):
        texts["dispersions.yaml"] = dispersions
    return texts


def _constants(models: Sequence[Model], answers: Answers) -> dict[str, float]:
    """Return reference dimensions and mass properties in SI, preferring earlier files."""
    expected = ("area", "span", "chord", "mass", "inertia_xx", "inertia_yy", "inertia_zz",
                "inertia_zx", "inertia_xy", "inertia_yz", "center_of_gravity_x",
                "center_of_gravity_y", "center_of_gravity_z")  # fmt: skip
    constants: dict[str, float] = {}
    for model in models:
        outputs = {
            name: variable
            for name, variable in find_signals(model.outputs).items()
            if name in expected
        }
        if not outputs:
            continue
        input_values = {
            v.key: answers[model.path.name].get(v.identifier, v.initial) for v in model.inputs
        }
        numbers = {
            key: value if isinstance(value, float | int) else 0.0
            for key, value in input_values.items()
        }
        results: Any = (
            make_function(model)(**numbers) if any(v.computed for v in outputs.values()) else None
        )
        for name, variable in outputs.items():
            value = getattr(results, variable.key) if variable.computed else variable.initial
            constants.setdefault(name, float(value or 0.0) * signed_factor(model, variable, name))
    return constants


def _vehicle(
    models: Sequence[Model],
    values: Mapping[str, float],
    sections: Mapping[str, str],
    effectors: Mapping[str, Any],
) -> str:
    for name in ("inertia_xy", "inertia_yz", "center_of_gravity_y"):
        if abs(values.get(name, 0.0)) > 1e-9 * values["mass"]:
            raise InputError(
                models[0].path,
                f"the {name.replace('_', ' ')} is {values[name]:g}",
                "a vehicle that is symmetric about the x-z plane",
            )
    lines = [
        (
            f"# Imported from {', '.join(fold(model.path.name) for model in models)} (DAVE-ML, "
            "ANSI/AIAA S-119)."
        ),
        f"name: {_plain(models[0].path.stem.split('_')[0])}",
        "",
        "reference:",
        f"  area: {values['area']!r} m2",
        f"  span: {values.get('span', 1.0)!r} m",
        f"  chord: {values.get('chord', 1.0)!r} m",
        "",
        "mass:",
        f"  start: {values['mass']!r} kg",
        "  points:",
        f"    - mass: {values['mass']!r} kg",
        *(
            f"      inertia_{axis}: {values[f'inertia_{axis}']!r} kg m2"
            for axis in ("xx", "yy", "zz")
        ),
        (
            f"      inertia_matrix_element_13: {-values.get('inertia_zx', 0.0)!r} kg m2 # minus "
            "the product of inertia"
        ),
        *(
            f"      center_of_gravity_{axis}: {values.get(f'center_of_gravity_{axis}', 0.0)!r} m"
            for axis in ("x", "z")
        ),
        "",
        "surfaces: # the files do not describe actuators",
        "  ideal: true",
        "  limit: 30 deg",
    ]
    if effectors:
        lines += ["", "effectors:"]
        lines += [f"  {name}: {json.dumps(entry)}" for name, entry in effectors.items()]
    for name, section in sections.items():
        lines += ["", f"{name}:", section]
    lines += _limits(models)
    return "\n".join(lines) + "\n"


def _limits(models: Sequence[Model]) -> list[str]:
    """Return limits on angle of attack and sideslip at the ends of the tables' ranges."""
    ends: dict[str, list[float]] = {"angle_of_attack": [], "sideslip": []}
    for model in models:
        for look_up in (
            variable.look_up for variable in model.variables.values() if variable.look_up
        ):
            for axis, argument in enumerate(look_up.arguments):
                input_variable = model.variables[argument.variable]
                quantity = quantity_of(input_variable)
                if input_variable.computed or quantity not in ends:
                    continue
                degree = math.degrees(factor_to_si(model, input_variable, quantity))
                points = look_up.coordinates(axis)
                ends[quantity] += [degree * float(points.min()), degree * float(points.max())]
    lines = []
    if ends["angle_of_attack"]:
        lines.append(
            f"  angle_of_attack: [{min(ends['angle_of_attack']):g} deg, "
            f"{max(ends['angle_of_attack']):g} deg]"
        )
    if min(ends["sideslip"], default=0.0) < 0.0:
        lines.append(f"  sideslip: {max(map(abs, ends['sideslip'])):g} deg")
    return ["", "limits: # ends of the tables", *lines] if lines else []


def _controller(model: Model, module: str) -> str:
    lines = [
        (
            f"# The control law of {fold(model.path.name)}; commands can change over time: {{0 s: "
            "..., 5 s: ...}."
        ),
        "law: python",
        f"file: {module}",
        "rate: 200 Hz",
    ]
    commands = command_inputs(model)
    lines += ["commands:"] if commands else []
    for variable in commands:
        unit, _ = command_unit(variable)
        value = f"{variable.initial or 0.0!r}"
        written = (
            {"m": "ft", "m/s": "kt", "rad": "deg"}.get(unit)
            if variable.units in ("ft", "nmi_h", "deg")
            else unit
        )
        lines.append(
            f"  {variable.key}: {value}{'' if unit == '-' else f' {written}'} # {variable.name}"
        )
    return "\n".join(lines) + "\n"
