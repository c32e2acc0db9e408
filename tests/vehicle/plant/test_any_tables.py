"""Tests of random vehicle files with tables over any axes and their build-up.

The compiled plant is compared with numpy and scipy.
"""

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from abhv_mc.io.documents import write_document
from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import build_up, look_up, make_cells
from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS, PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_document
from abhv_mc_vehicle.plant.parameters import PARAMETERS
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_coefficients, make_variables

POINTS = 32
WIDTH = 16
# Name in files, unit and SI per unit, range in that unit.
AXES = {
    "mach": ("", 1.0, (1.0, 20.0)),
    "alpha_deg": ("angle_of_attack", np.pi / 180.0, (-4.0, 20.0)),
    "beta_rad": ("sideslip", 1.0, (-0.3, 0.3)),
    "aileron_deg": ("aileron", np.pi / 180.0, (-20.0, 20.0)),
    "elevator_rad": ("elevator", 1.0, (-0.4, 0.4)),
    "rudder_deg": ("rudder", np.pi / 180.0, (-20.0, 20.0)),
    "eta": ("equivalence_ratio", 1.0, (0.0, 2.0)),
    "altitude_km": ("altitude", 1e3, (5.0, 45.0)),
    "mass_kg": ("mass", 1.0, (500.0, 1500.0)),
    "left_deg": ("left", np.pi / 180.0, (-30.0, 30.0)),
    "right_deg": ("right", np.pi / 180.0, (-30.0, 30.0)),
}
EFFECTORS = {
    "left": {"aileron": -1.0, "elevator": 0.7},
    "right": {"aileron": 1.0, "elevator": 0.7, "rudder": 0.2},
}
FACTORS = ("angle_of_attack", "sideslip", "aileron", "rudder", "elevator", "left", "right",
    "roll_rate", "pitch_rate",
           "yaw_rate", "mach", "equivalence_ratio")  # fmt: skip
REST = {
    key: make_document("vehicle", "ghame_x").data[key]
    for key in ("name", "reference", "mass", "surfaces")
}


@kernel
def compute(vehicle, cells, variables, parameters, coefficients):
    """Return the coefficients [coefficient, point].

    They are at variables [variable, point] under parameters [parameter, point].
    """
    Z = np.zeros((s.LAW, WIDTH))
    T = np.zeros((s.MAX_TABLE_ROWS, WIDTH))
    for first in range(0, variables.shape[1], WIDTH):
        for lane in range(WIDTH):
            for i in range(s.N_VARIABLES):
                Z[s.VAR + i, lane] = variables[i, first + lane]
            for i in range(s.N_PARAMETERS):
                Z[s.P + i, lane] = parameters[i, first + lane]
        look_up(Z, T, WIDTH, vehicle.tables, cells)
        build_up(Z, T, WIDTH, vehicle.build_up, vehicle.build_up.factor)
        for c in range(s.N_COEFFICIENTS):
            for lane in range(WIDTH):
                coefficients[c, first + lane] = Z[s.COEF + c, lane]


def write_table(generator, path, columns, state):
    """Add a random table over these columns; return its values by scipy.

    One node of each axis is at the first point.
    """
    grids = []
    for column in columns:
        low, high = AXES[column][2]
        low, high = low + 0.1 * (high - low), high - 0.1 * (high - low)  # points lie outside, too
        inner = [x for x in state[column][:1] if low < x < high]
        grids.append(
            np.sort([low, high, *inner, *generator.uniform(low, high, generator.integers(0, 4))])
        )
    values = generator.normal(size=[grid.size for grid in grids])
    rows = [
        ",".join(repr(float(x)) for x in (*point, value))
        for point, value in zip(itertools.product(*grids), values.ravel(), strict=True)
    ]
    path.write_text("\n".join([",".join([*columns, "value"]), *rows]) + "\n")
    points = [
        np.clip(state[column], grid[0], grid[-1])
        for column, grid in zip(columns, grids, strict=True)
    ]
    return RegularGridInterpolator(grids, values)(np.stack(points, axis=-1))


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_vehicle_file_is_what_scipy_makes_of_it(seed, tmp_path):
    generator = np.random.default_rng(seed)
    state = {}  # in the files' units
    for column, (_, _, (low, high)) in AXES.items():
        state[column] = generator.uniform(low, high, POINTS)
    if (
        generator.random() < 0.5
    ):  # flights that share their cells take another way through the look-up
        state = {
            column: np.full(POINTS, x[0]) + 1e-9 * generator.random(POINTS)
            for column, x in state.items()
        }
    si = {(name or column): state[column] * factor for column, (name, factor, _) in AXES.items()}
    for effector, mix in EFFECTORS.items():
        si[effector] = sum(share * si[axis] for axis, share in mix.items())
        state[f"{effector}_deg"] = np.degrees(si[effector])
    rates = {
        f"{name}_rate": generator.uniform(-0.01, 0.01, POINTS) for name in ("roll", "pitch", "yaw")
    }

    parameters = generator.uniform(0.5, 1.5, (len(PARAMETERS), POINTS))
    parameters[PARAMETER_INDEX["one"]] = 1.0
    expected = np.zeros((len(COEFFICIENTS), POINTS))
    tables, terms = {}, {}
    chosen = [
        ("beta_rad",),
        ("altitude_km", "mach"),
        ("eta",),
    ]  # c_tn: a lift table over the equivalence ratio
    chosen += [
        tuple(generator.permutation(list(AXES))[: generator.integers(1, 4)])
        for _ in range(generator.integers(2, 9))
    ]
    for i, columns in enumerate(chosen):
        value = write_table(generator, tmp_path / f"t{i}.csv", columns, state)
        c = 0 if columns == ("eta",) else int(generator.integers(len(COEFFICIENTS)))
        factor = (
            str(generator.choice(FACTORS))
            if generator.random() < 0.5 and columns != ("eta",)
            else None
        )
        scale = float(generator.uniform(-2.0, 2.0))
        per_degree = (
            factor is not None
            and factor not in ("mach", "equivalence_ratio")
            and generator.random() < 0.5
        )
        unit = (
            "-"
            if factor in (None, "mach", "equivalence_ratio")
            else "1/deg"
            if per_degree
            else "1/rad"
        )
        tables[f"t{i}"] = {"file": f"t{i}.csv", "unit": unit}
        times = {"times": factor} if factor else {}
        terms.setdefault(COEFFICIENTS[c], []).append({"table": f"t{i}", "scale": scale} | times)
        term = scale * value * (180.0 / np.pi if per_degree else 1.0)
        term = term * (1.0 if factor is None else rates[factor] if factor in rates else si[factor])
        dispersed = PARAMETER_INDEX.get(f"aero.{COEFFICIENTS[c]}.{factor}", 0)
        expected[c] += parameters[dispersed] * term

    write_document(
        tmp_path / "vehicle.yaml",
        REST | {"effectors": EFFECTORS, "tables": tables, "aerodynamics": terms},
    )
    vehicle = load_vehicle(tmp_path / "vehicle.yaml")
    variables = make_variables(
        vehicle,
        **{name: x for name, x in si.items() if name not in EFFECTORS},
        **{f"{name}_hat": x for name, x in rates.items()},
    )
    compiled = np.empty((len(COEFFICIENTS), POINTS))
    compute(vehicle, make_cells(WIDTH), variables, parameters, compiled)
    assert compiled == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert evaluate_coefficients(vehicle, variables, parameters) == pytest.approx(
        compiled, rel=1e-12, abs=1e-12
    )
