"""Linear models in files for numpy (.npz), MATLAB (.mat) and other programs (.json)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.linearize import (
    actuator_matrices,
    closed_loop,
    closed_period,
    open_loop,
    sensor_states,
)
from abhv_mc_vehicle.stability.margins import Linear
from abhv_mc_vehicle.stability.point_slopes import Points
from abhv_mc_vehicle.stability.probe import law_memory_rows, mix_matrix, plant_states, plant_units

FORMATS = (".npz", ".mat", ".json")


def make_model(plan: FlightPlan, points: Points, linear: Linear) -> dict[str, Any]:
    """Return the matrices (arrays) and names (lists of text) of the first point's models.

    `plant` maps commands to the measurement; `loop` maps actuator inputs to minus the controller's
    commands, with all loops cut; `closed` maps disturbances of the commands to true outputs and
    commands. `plant_continuous` has the actuator commands as inputs. All other models are sampled
    with `period`. If a controller repeats after several `ticks`, the sampled models apply to the
    tick of the point, and `closed_over_ticks` is the closed loop over all ticks.
    """
    m = linear.law_A.shape[1]
    d = int(linear.delay[0])
    old = [f"{name}_{age}_ago" for age in range(1, d + 1) for name in path.COORDINATES]
    actuator_A, actuator_B = actuator_matrices(plan, points.lane[:1])
    last = 10 + actuator_A.shape[1]
    k = len(linear.inputs)
    p = last + linear.plant_A.shape[1] - 10
    moved = np.array([*range(10), *range(last, p)])
    A = np.zeros((p, p))
    B = np.zeros((p, k))
    A[moved[:, None], moved] = linear.plant_A[0]
    A[moved, 10:last:2] = linear.plant_B[0]
    A[10:last, 10:last] = actuator_A[0]
    B[10:last] = actuator_B[0] if linear.apart is None else actuator_B[0] @ mix_matrix(plan.vehicle)
    loop_A, loop_B, loop_C = open_loop(linear, 0)
    n = len(loop_A)
    C = np.eye(10, p)
    none = np.zeros((10, k))
    # names of states, inputs and outputs with their units
    truth = _Named(path.COORDINATES, path.UNITS)
    commands = _Named(linear.inputs, (*["rad"] * (k - 1), "-"))
    memory = _Named(
        [*(f"law_{name}" for name in law_memory_rows(plan)), *sensor_states(plan, points)], [""] * m
    )
    plant = _Named(plant_states(plan.vehicle), plant_units(plan.vehicle))
    states = _Named(
        (*plant.names, *memory.names, *old), (*plant.units, *memory.units, *path.UNITS * d)
    )
    both = _Named((*truth.names, *commands.names), (*truth.units, *commands.units))
    closed_C = np.vstack([np.eye(10, n), -loop_C])
    no_feedthrough = np.zeros((10 + k, k))
    over_ticks = {"A": closed_period(linear, 0), "states": list(states.names)}
    return (
        {"ticks": len(linear.phases), "closed_over_ticks": over_ticks} if linear.phases else {}
    ) | {
        "period_s": linear.period,
        "measurement_delay_periods": d,
        "plant_continuous": _part(A, B, C, none, plant, inputs=commands, outputs=truth),
        "plant": _part(linear.A[0], linear.B[0], C, none, plant, inputs=commands, outputs=truth),
        "law": _part(
            linear.law_A[0],
            linear.law_B[0],
            linear.law_C[0],
            linear.law_D[0],
            memory,
            inputs=truth,
            outputs=commands,
        ),
        "loop": _part(
            loop_A, loop_B, loop_C, np.zeros((k, k)), states, inputs=commands, outputs=commands
        ),
        "closed": _part(
            closed_loop(linear, 0),
            loop_B,
            closed_C,
            no_feedthrough,
            states,
            inputs=commands,
            outputs=both,
        ),
        "point": {
            "states": np.concatenate(
                [
                    points.path[0],
                    np.pad(points.controls[0][:, None], ((0, 0), (0, 1))).ravel(),
                    points.custom[0],
                ]
            ),
            "measured": points.measured[0],
            "law_memory": points.memory[0],
            "mass_kg": float(points.mass[0]),
            "latitude_rad": float(points.latitude[0]),
        },
    }


class _Named(NamedTuple):
    names: Sequence[str]
    units: Sequence[str]


def _part(
    A: Floats, B: Floats, C: Floats, D: Floats, states: _Named, *, inputs: _Named, outputs: _Named
) -> dict[str, Any]:
    signals = {"state": states, "input": inputs, "output": outputs}
    named = {f"{kind}s": list(signal.names) for kind, signal in signals.items()}
    units = {f"{kind}_units": list(signal.units) for kind, signal in signals.items()}
    return {"A": A, "B": B, "C": C, "D": D} | named | units


def stack_models(models: Sequence[dict[str, Any]], times: Sequence[float]) -> dict[str, Any]:
    """Combine models along a flight, with time as the first dimension of arrays."""

    def stack(values: list[Any]) -> Any:
        if isinstance(values[0], dict):
            return {key: stack([value[key] for value in values]) for key in values[0]}
        return (
            values[0]
            if isinstance(values[0], list)
            else np.stack([np.asarray(value) for value in values])
        )

    fixed = {key: models[0][key] for key in ("period_s", "measurement_delay_periods")}
    return {"time_s": np.array(times)} | stack(list(models)) | fixed


def write_model(file: Path, model: dict[str, Any]) -> None:
    """Write a model in the format given by the file's suffix.

    Entries of a `.npz` file have names such as `plant_A`. Raise InputError for another suffix.
    """
    check_format(file)
    with atomic_write(file) as temporary, temporary.open("wb") as stream:
        _write_to(stream, file.suffix, model)


def _write_to(stream: BinaryIO, suffix: str, model: dict[str, Any]) -> None:
    if suffix == ".json":
        stream.write((json.dumps(model, default=np.ndarray.tolist, indent=1) + "\n").encode())
        return
    if suffix == ".npz":
        flat: dict[str, Any] = {}
        for key, value in model.items():
            parts = value.items() if isinstance(value, dict) else [("", value)]
            flat.update({f"{key}_{name}".rstrip("_"): np.array(array) for name, array in parts})
        np.savez_compressed(stream, **flat)
        return
    from scipy.io import savemat

    def cells(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: cells(array) for name, array in value.items()}
        return np.array(value, object) if isinstance(value, list) else value

    savemat(stream, cells(model), oned_as="column")


def check_format(file: Path) -> None:
    """Raise InputError if the suffix of a file name is not in FORMATS."""
    if file.suffix not in FORMATS:
        raise InputError(
            file,
            f"found the ending '{file.suffix}'",
            "a file name that ends in .npz, .mat or .json",
        )
