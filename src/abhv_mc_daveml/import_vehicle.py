"""Import of DAVE-ML files as Python functions, a vehicle file and the air of a mission.

The air profile is computed from a model of the atmosphere.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from abhv_mc.io.documents import StrictModel, read_document, validate
from abhv_mc.io.messages import InputError, Refusal, joined, one_of, quoted
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
from abhv_mc_daveml.writer import make_function, run_shots, write_model
from abhv_mc_vehicle.imported_vehicle import Body, write_vehicle
from abhv_mc_vehicle.user_code.module_text import (
    Line,
    free_name,
    write_text,
    write_unless_edited,
)

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
    inputs = dict[str, tuple[float, float]]()  # value at altitude 0, and slope
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
    scales = {outputs[name].key: _scale_of(model, outputs[name], name) for name in quantities}
    columns = "density [kg/m3]" if len(quantities) == 1 else "pressure [Pa],temperature [K]"
    rows = [f"altitude [m],{columns}"]
    for altitude in ALTITUDES.tolist():
        result = function(**{key: a + b * altitude for key, (a, b) in inputs.items()})
        values = [
            getattr(result, key) * factor + offset for key, (factor, offset) in scales.items()
        ]
        if not all(0.0 < value < math.inf for value in values):
            raise InputError(
                model.path,
                f"the {joined(quantities, 'or')} at {altitude:g} m is not positive",
                f"positive values up to {ALTITUDES[-1]:g} m",
            )
        if quantities == ("density", "pressure"):
            density, pressure = values
            values = [pressure, pressure / (density * _GAS_CONSTANT)]
        rows.append(",".join(map(repr, (altitude, *values))))
    return "\n".join(rows) + "\n"


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
Answers = dict[str, dict[str, Answer]]  # answers by file name and varID


class _AnswerFile(StrictModel, extra="allow"):
    """Content of ``import.yaml``: answers by file name, and custom effectors."""

    __pydantic_extra__: Answers
    effectors: dict[Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$")], Any] = {}


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
    path = folder / ANSWERS
    values, effectors, is_complete = _read_answers(path, models, questions)
    if not is_complete:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(path, _write_answers(values, effectors, questions))
    missing = [
        f"{name}: {key}"
        for name, file_answers in values.items()
        for key, value in file_answers.items()
        if value is None
    ]
    if missing:
        raise InputError(
            path,
            f"values are missing for {quoted(missing)}",
            "values in this file (enter them and repeat the command)",
        )
    paths, kept = write_unless_edited(folder, _write_parts(models, values, effectors))
    shots = {model.path.name: len(model.shots) for model in models}
    return Imported((*(() if is_complete else (path,)), *paths), shots, kept)


def _read_answers(
    path: Path, models: Sequence[Model], questions: Mapping[str, Sequence[Variable]]
) -> tuple[Answers, dict[str, Any], bool]:
    """Return the answers, the custom effectors, and whether the file lists all questions.

    Raise InputError if the file is invalid.
    """
    values: Answers = {
        name: {variable.identifier: variable.initial for variable in variables}
        for name, variables in questions.items()
    }
    if not path.exists():
        return values, {}, not any(questions.values())
    document = read_document(path)
    content = validate(document, _AnswerFile)
    answers = content.model_extra or {}
    by_name = {model.path.name: model for model in models}
    for name, file_answers in answers.items():
        if name not in by_name:
            raise document.key_error(
                (name,), f"unknown name '{name}'", one_of((*by_name, "effectors"), name)
            )
        variables = {variable.identifier: variable for variable in questions[name]}
        for key, value in file_answers.items():
            if key not in variables:
                raise document.key_error(
                    (name, key), f"unknown signal '{key}'", one_of(variables, key)
                )
            if isinstance(value, str):
                try:
                    parse_answer(by_name[name], variables[key], value, content.effectors)
                except Refusal as refusal:
                    raise document.error((name, key), refusal.found, refusal.expected) from None
            if value is not None:
                values[name][key] = value
    is_complete = all(set(values[name]) <= set(answers.get(name, ())) for name in values)
    return values, content.effectors, is_complete


def _write_answers(
    values: Answers, effectors: Mapping[str, Any], questions: Mapping[str, Sequence[Variable]]
) -> str:
    """Return the text of ``import.yaml``, in which missing values are empty."""
    lines = [
        "# Inputs that no signal of the program supplies: numbers in the units of the file, "
        "or sums of signals such as",
        "# elevator + aileron. Custom surfaces: effectors: {left_flap: {elevator: 1, aileron: 1}}.",
    ]
    if effectors:
        lines.append(f"effectors: {json.dumps(effectors)}")
    for name, variables in questions.items():
        lines += [f"{json.dumps(name, ensure_ascii=False)}:"] if variables else []
        for variable in variables:
            value = values[name][variable.identifier]
            key = json.dumps(variable.identifier, ensure_ascii=False)
            lines += [f"  # {variable.words}", f"  {key}:{'' if value is None else f' {value}'}"]
    return "\n".join(lines) + "\n"


def _write_parts(
    models: Sequence[Model], answers: Answers, effectors: Mapping[str, Any]
) -> dict[str, str]:
    values = _constants(models, answers)
    texts: dict[str, str] = {}
    sections: dict[str, str] = {}
    for model in models:
        extra: list[Line] = []
        stem = free_name(model.path.stem.lower())
        file_answers = answers[model.path.name]
        for kind in kinds_of(model):
            section = f"{kind}:\n  python: {stem}.py\n  "
            if kind == "aerodynamics":
                lengths = {"SPAN": values.get("span", 1.0), "CHORD": values.get("chord", 1.0)}
                extra += write_coefficients(model, file_answers, lengths, effectors)
                sections[kind] = f"{section}function: coefficients\n  frame: {frame_of(model)}"
            elif kind == "propulsion":
                extra += write_thrust(model, file_answers)
                sections[kind] = f"{section}function: thrust\n  throttle: [0, 1]\n  ideal: true"
            elif kind == "control":
                extra += write_law(model, file_answers)
                texts[f"{stem}.yaml"] = _controller(model, f"{stem}.py")
            elif kind == "atmosphere":
                texts[f"{stem}.csv"] = write_air_profile(model, file_answers)
        texts[f"{stem}.py"] = write_model(model, extra)
    if "aerodynamics" in sections and "mass" in values:
        texts["vehicle.yaml"] = _vehicle(models, values, effectors, sections.values())
    if dispersions := write_dispersions(models):
        texts["dispersions.yaml"] = dispersions
    return texts


def _constants(models: Sequence[Model], answers: Answers) -> dict[str, float]:
    """Return reference dimensions and mass properties in SI, preferring earlier files."""
    constants: dict[str, float] = {}
    for model in models:
        outputs = {
            name: variable
            for name, variable in find_signals(model.outputs).items()
            if name in ("area", "span", "chord", "mass")
            or name.startswith(("inertia_", "center_of_gravity_"))
        }
        results: Any = None
        if any(v.computed for v in outputs.values()):
            file_answers = answers[model.path.name]
            numbers = {v.key: file_answers.get(v.identifier, v.initial) for v in model.inputs}
            results = make_function(model)(
                **{k: x if isinstance(x, float | int) else 0.0 for k, x in numbers.items()}
            )
        for name, variable in outputs.items():
            value = getattr(results, variable.key) if variable.computed else variable.initial
            constants.setdefault(name, float(value or 0.0) * signed_factor(model, variable, name))
    return constants


def _vehicle(
    models: Sequence[Model],
    values: Mapping[str, float],
    effectors: Mapping[str, Any],
    sections: Iterable[str],
) -> str:
    for name in ("inertia_xy", "inertia_yz", "center_of_gravity_y"):
        if abs(values.get(name, 0.0)) > 1e-9 * values["mass"]:
            raise InputError(
                models[0].path,
                f"the {name.replace('_', ' ')} is {values[name]:g}",
                "a vehicle that is symmetric about the x-z plane",
            )
    names = ", ".join(model.path.name for model in models)
    body = Body(
        area=values["area"],
        span=values.get("span", 1.0),
        chord=values.get("chord", 1.0),
        mass=values["mass"],
        inertia=(
            *(values[f"inertia_{axis}"] for axis in ("xx", "yy", "zz")),
            -values.get("inertia_zx", 0.0),
        ),
        center=[values.get(f"center_of_gravity_{axis}", 0.0) for axis in "xz"],
    )
    own = [f"effectors: {json.dumps(effectors)}"] if effectors else []
    return write_vehicle(
        models[0].path.stem.split("_")[0],
        [f"Imported from {names} (DAVE-ML, ANSI/AIAA S-119)."],
        body,
        (*own, *sections, *_limits(models)),
    )


def _limits(models: Sequence[Model]) -> list[str]:
    """Return limits on angle of attack and sideslip at the ends of the tables' ranges."""
    ends: dict[str, list[float]] = {"angle_of_attack": [], "sideslip": []}
    for model in models:
        for look_up in filter(None, (v.look_up for v in model.variables.values())):
            for axis, argument in enumerate(look_up.arguments):
                variable = model.variables[argument.variable]
                quantity = quantity_of(variable)
                if variable.computed or quantity not in ends:
                    continue
                degree = math.degrees(factor_to_si(model, variable, quantity))
                points = degree * look_up.table.coordinates(axis)
                ends[quantity] += [float(points.min()), float(points.max())]
    alpha, beta = ends.values()
    lines = [f"  angle_of_attack: [{min(alpha):g} deg, {max(alpha):g} deg]"] if alpha else []
    if min(beta, default=0.0) < 0.0:
        lines.append(f"  sideslip: {max(map(abs, beta)):g} deg")
    return ["\n".join(["limits: # ends of the tables", *lines])] if lines else []


def _controller(model: Model, module: str) -> str:
    lines = [
        f"# The control law of {fold(model.path.name)}; commands can change over time: {{0 s: "
        "..., 5 s: ...}.",
        "law: python",
        f"file: {module}",
        "rate: 200 Hz",
    ]
    commands = command_inputs(model)
    lines += ["commands:"] if commands else []
    for variable in commands:
        unit, _ = command_unit(variable)
        if variable.units in ("ft", "nmi_h", "deg"):
            unit = {"m": "ft", "m/s": "kt", "rad": "deg"}[unit]
        value = f"{variable.initial or 0.0!r}{'' if unit == '-' else f' {unit}'}"
        lines.append(f"  {variable.key}: {value} # {variable.name}")
    return "\n".join(lines) + "\n"
