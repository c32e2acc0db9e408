"""A vehicle given as functions has the results of the same vehicle given as tables."""

import numpy as np
import pytest
from short_flights import rows_of

from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.plant.trim import FlightPoint, trim
from abhv_mc_vehicle.stability.analysis import analyse
from abhv_mc_vehicle.stability.linearize import linearize
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.file import read_vehicle_file
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_coefficients, make_variables

CONFIGS = shipped_configs()
_FACTOR = {
    None: "",
    "sideslip": " * air.sideslip",
    **{f"{name}_rate": f" * rates.{name}_rate" for name in ("roll", "pitch", "yaw")},
}
_NAMES = {
    "lift": "CL",
    "drag": "CD",
    "side_force": "CY",
    "rolling_moment": "Cl",
    "pitching_moment": "Cm",
    "yawing_moment": "Cn",
}


def write_ghame_x(folder, frame="stability", point=(0.0, 0.0)):
    """Write ``ghame_x`` with coefficients and thrust as Python functions."""
    file = read_vehicle_file(CONFIGS / "vehicle" / "ghame_x.yaml")
    content = file.content
    lines = ["from abhv_mc.extend import Coefficients, Thrust, sincos, table", ""]
    nodes = {
        "mach": set(),
        "angle_of_attack": set(),
        "equivalence_ratio": set(),
    }
    calls = {}
    for name, table in file.tables.items():
        if not table.axes:
            calls[name] = repr(float(table.values))
            continue
        for axis in table.axes:
            nodes[VARIABLES[axis.variable]] |= set(axis.grid.tolist())
        grids = ", ".join(repr(tuple(axis.grid.tolist())) for axis in table.axes)
        lines.append(f"t_{name} = table({grids}, {table.values.tolist()!r})")
        arguments = ", ".join(f"air.{VARIABLES[axis.variable]}" for axis in table.axes)
        calls[name] = f"t_{name}({arguments.replace('air.equivalence_ratio', 'throttle')})"
    lines += ["", "", "def coefficients(air, controls, rates):"]
    for coefficient, short in _NAMES.items():
        terms = [
            f"{term.scale!r} * {calls[term.table]}"
            + _FACTOR.get(term.times, f" * controls.{term.times}")
            for term in getattr(content.aerodynamics, coefficient)
        ]
        lines.append(f"    {short} = {' + '.join(terms)}")
    if frame == "body":
        lines += [
            "    s, c = sincos(air.angle_of_attack)",
            "    CX, CZ = CL * s - CD * c, -CL * c - CD * s",
        ]
        x, z, b, d = *point, content.reference.span, content.reference.chord
        # Moments about a point at (x, 0, z) of the same forces at the moment reference.
        lines += [
            f"    Cl, Cm, Cn = Cl + {z / b!r} * CY, Cm - ({z / d!r} * CX - {x / d!r} * CZ), Cn "
            f"- {x / b!r} * CY"
        ]
        lines.append("    return Coefficients(CX=CX, CY=CY, CZ=CZ, Cl=Cl, Cm=Cm, Cn=Cn)")
    else:
        lines.append("    return Coefficients(CL=CL, CD=CD, CY=CY, Cl=Cl, Cm=Cm, Cn=Cn)")
    engine = content.propulsion
    size = engine.stoichiometric_ratio * engine.cowl_area
    lines += [
        "",
        "",
        "def thrust(air, throttle):",
        f"    flow = {size!r} * throttle * air.density * air.airspeed * "
        f"{calls[engine.capture_area_ratio]}",
        f"    force = {engine.standard_gravity!r} * flow * {calls[engine.specific_impulse]}",
        "    return Thrust(force_x=force, fuel_flow=flow, "
        f"moment_y={engine.thrust_line.offset!r} * force)",
        "",
    ]
    (folder / "own.py").write_text("\n".join(lines), encoding="utf-8")
    text = (CONFIGS / "vehicle" / "ghame_x.yaml").read_text(encoding="utf-8")
    head = text[: text.index("propulsion:")] + text[text.index("limits:") : text.index("tables:")]
    written = {name: [float(x) for x in sorted(values)] for name, values in nodes.items()}
    head += f"""
aerodynamics:
  python: own.py
  frame: {frame}
  reference_point: {{x: {point[0]} m, z: {point[1]} m}}
  nodes: {written}
propulsion:
  python: own.py
  throttle: [{engine.equivalence_ratio[0]}, {engine.equivalence_ratio[1]}]
  bandwidth: {engine.bandwidth} rad/s
  damping: {engine.damping}
  rate_limit: {engine.rate_limit} 1/s
"""
    path = folder / "functions.yaml"
    path.write_text(head, encoding="utf-8")
    return path


def test_coefficients_and_trims_are_those_of_the_tables(tmp_path):
    tables, functions = (
        load_vehicle(CONFIGS / "vehicle" / "ghame_x.yaml"),
        load_vehicle(write_ghame_x(tmp_path, "body", (0.3, -0.2))),
    )
    rng = np.random.default_rng(1)
    values = {"mach": rng.uniform(2, 8, 50), "angle_of_attack": rng.uniform(-0.1, 0.3, 50)}
    values |= {
        name: rng.uniform(-0.2, 0.2, 50) for name in ("sideslip", "aileron", "rudder", "elevator")
    }
    values |= {
        f"{name}_rate_hat": rng.uniform(-0.01, 0.01, 50) for name in ("roll", "pitch", "yaw")
    }
    ours = evaluate_coefficients(functions, make_variables(functions, **values))
    theirs = evaluate_coefficients(tables, make_variables(tables, **values))
    np.testing.assert_allclose(
        ours[:3], theirs[:3], rtol=1e-12, atol=1e-14
    )  # moments are about another point
    for bank in (0.0, 0.9):
        point = FlightPoint(20e3, 1400.0, bank, 0.5)
        a, b = trim(tables, WGS84, point), trim(functions, WGS84, point)
        assert not b.fault
        for name in ("angle_of_attack", "elevator", "equivalence_ratio"):
            assert getattr(a, name) == pytest.approx(getattr(b, name), abs=1e-10), name
        assert b.fuel_flow == pytest.approx(a.fuel_flow, rel=1e-10)


def test_dispersed_flights_are_those_of_the_tables(tmp_path):
    cases = {
        "aero.lift": 1.1,
        "aero.rolling_moment.roll_rate": 0.7,
        "control.elevator_effectiveness": 0.8,
        "aero.yawing_moment.sideslip": 0.6,
        "propulsion.thrust": 0.9,
        "mass.center_of_gravity_x": 0.02,
    }
    parameters = rows_of({}, *({name: value} for name, value in cases.items()))
    flights = {}
    for name, vehicle in (
        ("tables", "ghame_x"),
        ("functions", str(write_ghame_x(tmp_path, "body"))),
    ):
        flights[name] = fly(
            make_flight_plan("s_manoeuvre", vehicle), parameters, 100, keep_states=True
        )
    assert (flights["tables"].outcome == flights["functions"].outcome).all()
    altitude = [flights[name].states[:, :, 0] for name in ("tables", "functions")]
    assert np.nanmax(np.abs(altitude[0] - altitude[1])) < 1e-6
    assert np.nanmax(np.abs(altitude[0] - altitude[0][0])) > 1.0  # the dispersions are felt


def test_a_function_that_does_not_fit_is_said_with_its_line(tmp_path):
    path = write_ghame_x(tmp_path)
    own = tmp_path / "own.py"
    text = own.read_text(encoding="utf-8")
    own.write_text(
        text.replace("def coefficients(air, controls, rates)", "def coefficients(air, weather)"),
        encoding="utf-8",
    )
    with pytest.raises(InputError, match=r"own\.py:\d+:23: .*'weather'"):
        load_vehicle(path)
    own.write_text(text.replace("def coefficients", "def others"), encoding="utf-8")
    with pytest.raises(InputError, match="'coefficients'"):
        load_vehicle(path)
    settings = (
        "from typing import NamedTuple\nclass Settings(NamedTuple):\n    a: float = float('nan')\n"
    )
    own.write_text(text + settings, encoding="utf-8")
    with pytest.raises(InputError, match=r"own\.py\S*: .*'a'"):
        load_vehicle(path)


@pytest.mark.parametrize(
    ("lift", "flow", "quantity"),
    [("air.mach * INF * 0.0", "0.0", "coefficient"), ("0.0", "INF", "force")],
)
def test_a_function_that_is_not_finite_is_rejected(tmp_path, lift, flow, quantity):
    path = write_ghame_x(tmp_path)
    functions = f"""
from abhv_mc.extend import Coefficients, Thrust
INF = 1e308 * 10.0
def coefficients(air):
    return Coefficients(CL={lift})
def thrust(air, throttle):
    return Thrust(force_x=throttle, fuel_flow={flow})
"""
    (tmp_path / "own.py").write_text(functions, encoding="utf-8")
    with pytest.raises(InputError, match=rf"own\.py:\d+: .*\b{quantity}\b.*\bfinite\b"):
        make_flight_plan("level", str(path), "tlc")


@pytest.mark.thorough
def test_margins_are_those_of_the_tables(tmp_path):
    plans = [
        make_flight_plan("s_manoeuvre", vehicle, "lqr_retuned_ghame_x")
        for vehicle in ("ghame_x", str(write_ghame_x(tmp_path)))
    ]
    tables, functions = (
        analyse(linearize(p, flown_points(p, nominal_parameters(), 45.0).points)) for p in plans
    )
    for name, actual, other in zip(
        tables.margins._fields, tables.margins, functions.margins, strict=True
    ):
        np.testing.assert_allclose(actual, other, rtol=1e-5, err_msg=name)
