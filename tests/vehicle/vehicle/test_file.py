"""Tests of vehicle files: packing in SI units, located errors, implausible numbers."""

import re
from dataclasses import replace

import numpy as np
import pytest

from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.kernel.plant.actuator_step import (
    DEAD_ZONE,
    ENGINE,
    FIRST_EFFECTOR,
    KINDS,
    RATE_LIMIT,
)
from abhv_mc_vehicle.kernel.plant.state import MAX_AXES, MAX_TABLE_ROWS
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.actuators import axis_limits
from abhv_mc_vehicle.vehicle.file import pack_vehicle, read_mass_points, read_vehicle_file
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
)
from abhv_mc_vehicle.vehicle.warnings import find_vehicle_warnings

SMALL = """\
name: small
reference: {area: 2 m2, span: 1 ft, chord: 3 m}
mass:
  start: 100 kg
  empty: 60 kg
  points:
    - {mass: 50 kg, inertia_xx: 10 kg m2, inertia_yy: 20 kg m2, inertia_zz: 25 kg m2}
    - {mass: 150 kg, inertia_xx: 30 kg m2, inertia_yy: 40 kg m2, inertia_zz: 45 kg m2, \
center_of_gravity_x: -10 cm}
effectors:
  flap: {elevator: 2.0, aileron: 0.5}
surfaces: {bandwidth: 50 rad/s, damping: 0.7, limit: 20 deg, rate_limit: 400 deg/s}
propulsion:
  kind: thrust_area
  area: push
  specific_impulse: impulse
  thrust_line: {inclination: 30 deg, offset: 2 m}
  equivalence_ratio: [0.1, 1.5]
  bandwidth: 20 rad/s
  damping: 1.0
  rate_limit: 5 1/s
limits: {angle_of_attack: [-3 deg, 21 deg], sideslip: 15 deg}
tables:
  push: {file: push.csv, unit: ft2}
  impulse: {constant: 1000, unit: s}
  slope: {constant: 0.02, unit: 1/deg, scale: 1.5}
  coupling: {file: coupling.csv}
aerodynamics:
  lift:
    - {table: slope, times: angle_of_attack}
    - {table: slope, times: flap, scale: -2.0}
    - {table: coupling}
"""
PUSH = "phi,value\n0,0\n2,100\n"
COUPLING = "phi,value\n0,0\n1,0.006\n"


@pytest.fixture
def write(tmp_path):
    (tmp_path / "push.csv").write_text(PUSH)
    (tmp_path / "coupling.csv").write_text(COUPLING)
    (tmp_path / "slow.csv").write_text("mach,value\n4,900\n6,-1\n")
    (tmp_path / "tons.csv").write_text("mass_kg,value\n0.05,1\n0.15,2\n")

    def write(text):
        path = tmp_path / "vehicle.yaml"
        path.write_text(text)
        return path

    return write


def test_everything_becomes_si_and_radians(write):
    vehicle = load_vehicle(write(SMALL))
    c = vehicle.constants
    assert (c.area, c.span, c.chord) == (2.0, 0.3048, 3.0)
    assert (c.mass_start, c.mass_empty, c.capture_thrust) == (100.0, 60.0, 0.0)
    assert (c.thrust_cos, c.thrust_sin, c.thrust_offset_z) == pytest.approx(
        (np.sqrt(0.75), 0.5, 2.0)
    )
    assert vehicle.actuators[:3, RATE_LIMIT] == pytest.approx(np.radians(400.0))
    assert c.angle_of_attack_min == pytest.approx(np.radians(-3.0))
    assert vehicle.effector_mix.tolist() == [[0.5, 0.0, 2.0]]


def test_single_axes_have_their_own_smaller_limits(write):
    own = "surfaces: {limits: {rudder: 6 deg}, "
    packed = load_vehicle(write(SMALL.replace("surfaces: {", own)))
    ends = np.deg2rad([-20.0, 20.0, -6.0, 6.0, -20.0, 20.0])
    np.testing.assert_allclose(axis_limits(packed), ends)
    with pytest.raises(InputError, match="rudder"):
        load_vehicle(write(SMALL.replace("surfaces: {", own.replace("6 deg", "21 deg"))))


def test_an_effector_has_what_it_does_not_say_from_the_surfaces(write):
    text = SMALL.replace("surfaces: {", "surfaces: {dead_zone: 0.1 deg, backlash: 0.2 deg, ")
    text = text.replace("aileron: 0.5}", "aileron: 0.5, kind: first_order, backlash: 0.3 deg}")
    actuators = load_vehicle(write(text)).actuators
    assert actuators[:3, DEAD_ZONE:] == pytest.approx(np.radians([[0.1, 0.2]] * 3))
    assert actuators[ENGINE].tolist() == [
        0.1,
        1.5,
        5.0,
        20.0,
        1.0,
        KINDS.index("second_order"),
        0,
        0,
    ]
    lag = [np.radians(400.0), 50.0, 0.5, KINDS.index("first_order")]
    assert actuators[FIRST_EFFECTOR, 2:] == pytest.approx([*lag, *np.radians([0.1, 0.3])])


def test_terms_scales_and_effectors(write):
    vehicle = load_vehicle(write(SMALL))
    variables = make_variables(
        vehicle,
        angle_of_attack=0.1,
        elevator=[0.03, 0.0],
        aileron=[0.0, 0.04],
        equivalence_ratio=0.5,
        mass=75.0,
    )
    per_rad = 0.03 * 180.0 / np.pi
    expected = per_rad * (0.1 - 2.0 * np.array([2.0 * 0.03, 0.5 * 0.04])) + 0.003
    assert evaluate_coefficients(vehicle, variables)[0] == pytest.approx(expected)
    fixed = evaluate_fixed(vehicle, variables)
    assert fixed["inertia_xx"] == pytest.approx(15.0)
    assert fixed["center_of_gravity_x"] == pytest.approx(-0.025)
    assert fixed["thrust_area"] == pytest.approx(25.0 * 0.09290304)
    assert fixed["specific_impulse"] == pytest.approx(1000.0)
    assert not fixed["capture_area_ratio"].any()


@pytest.mark.parametrize(("last", "is_accepted"), [(150, True), (90, False)])
def test_a_table_over_the_mass_covers_the_initial_mass(write, tmp_path, last, is_accepted):
    path = write(SMALL)
    (tmp_path / "coupling.csv").write_text(f"mass_kg,value\n50,0\n80,0.003\n{last},0.006\n")
    if is_accepted:
        vehicle = load_vehicle(path)
        variables = make_variables(vehicle, mass=115.0)
        assert evaluate_coefficients(vehicle, variables)[0] == pytest.approx(0.0045)
    else:
        with pytest.raises(InputError, match="50 to 90 kg"):
            load_vehicle(path)


@pytest.mark.parametrize(
    ("old", "new", "location", "fragment"),
    [
        ("area: 2 m2", "area: 2 m", (2, 19), "an area"),  # unit of another dimension
        ("area: 2 m2", "area: 1e-300 m2", (2, 19), "0.000001"),  # no size
        ("start: 100 kg", "start: 200 kg", (4, 10), "50 to 150 kg"),  # start outside the points
        ("mass: 150 kg", "mass: 40 kg", (8, 14), "increasing masses"),  # falling masses
        ("inertia_zz: 25", "inertia_zz: 31", (7, 7), "impossible"),  # impossible inertia
        ("[0.1, 1.5]", "[1.5, 0.1]", (17, 22), "minimum"),  # empty engine range
        ("area: push", "area: pull", (14, 9), "expected 'push', "),  # unknown table
        (
            "surfaces: {",
            "surfaces: {kind: first_order, ",
            (11, 11),
            "rate_limit",
        ),  # first order with damping
        ("surfaces: {", "surfaces: {dead_zone: -1 deg, ", (11, 23), "0"),  # negative dead zone
        (
            "aileron: 0.5}",
            "aileron: 0.5, kind: first_order, damping: 0.5}",
            (10, 9),
            "first_order",
        ),  # first-order effector with damping
        ("unit: 1/deg, ", "", (25, 10), "1/rad"),  # derivative without a unit
        ("constant: 1000", "constant: 30000", (24, 12), "30000 s"),  # exhaust velocity
        (
            "constant: 1000, unit: s",
            "file: slow.csv, unit: s",
            (24, 12),
            "-1 to 900 s",
        ),  # negative impulse
        (
            "file: coupling.csv",
            "file: tons.csv",
            (26, 13),
            "0.05 to 0.15 kg",
        ),  # tonnes as kilograms
        ("constant: 1000", "constant: .nan", (24, 23), "nan"),  # nan
        ("times: flap", "times: flop", (30, 29), "'flap'"),  # unknown variable
        (
            "{file: push.csv",
            "{file: push.csv, columns: {phi: etta}",
            (23, 41),
            "'etta'",
        ),  # unknown role
    ],
)
def test_errors_give_their_location(write, old, new, location, fragment):
    assert old in SMALL
    with pytest.raises(InputError) as caught:
        load_vehicle(write(SMALL.replace(old, new)))
    assert (caught.value.line, caught.value.column) == location, caught.value
    assert fragment in str(caught.value)


def with_tables(tables):
    """Return SMALL with additional lift terms, one per table."""
    text = SMALL.replace(
        "aerodynamics:\n",
        "".join(f"  {name}: {entry}\n" for name, entry in tables) + "aerodynamics:\n",
    )
    return text + "".join(f"    - {{table: {name}}}\n" for name, _ in tables)


def test_too_many_tables_or_grids_are_rejected(write, tmp_path):
    """Each table has a different Mach grid; SMALL itself has three grids."""
    with pytest.raises(InputError, match=rf"\b{MAX_TABLE_ROWS}\b"):
        load_vehicle(
            write(with_tables([(f"t{i}", f"{{constant: {i}}}") for i in range(MAX_TABLE_ROWS)]))
        )
    for i in range(MAX_AXES):
        (tmp_path / f"t{i}.csv").write_text(f"mach,value\n{i / 10},{i}\n40,1\n")
    tables = [(f"t{i}", f"{{file: t{i}.csv}}") for i in range(MAX_AXES)]
    assert (
        load_vehicle(write(with_tables(tables[: MAX_AXES // 2]))).tables.axis_variable.size
        == MAX_AXES // 2 + 3
    )
    with pytest.raises(InputError, match=r"\bgrids\b"):
        load_vehicle(write(with_tables(tables)))


def test_mass_points_from_csv(tmp_path):
    path = tmp_path / "mass.csv"
    path.write_text(
        "mass_t,inertia_xx_slug_ft2,inertia_yy_kg_m2,inertia_zz_kg_m2,center_of_gravity_x_ft\n1,10,20,20,-1\n2,20,40,40,0\n"
    )
    points = read_mass_points(path)
    assert [point.mass for point in points] == [1000.0, 2000.0]
    assert points[0].inertia_xx == pytest.approx(13.5581795)  # 10 slug ft2
    assert points[0].center_of_gravity_x == pytest.approx(-0.3048)
    assert points[1].inertia_matrix_element_13 == 0.0
    path.write_text(path.read_text().replace("center_of_gravity_x_ft", "mass_kg"))
    with pytest.raises(InputError, match=r"mass.csv:1:62: .*'mass'"):
        read_mass_points(path)


@pytest.mark.parametrize("name", ["ghame_x", "ghame_x_coupled"])
def test_the_demonstrator_is_ghame_at_scale(repository, name):
    k = 0.12
    full = load_vehicle(repository / "configs/vehicle/ghame.yaml")
    small = load_vehicle(repository / f"configs/vehicle/{name}.yaml")
    for field, power in {
        "area": 2,
        "span": 1,
        "chord": 1,
        "mass_start": 2,
        "mass_empty": 2,
    }.items():
        assert getattr(small.constants, field) == pytest.approx(
            getattr(full.constants, field) * k**power, rel=1e-9
        )
    assert small.constants.capture_thrust == pytest.approx(
        full.constants.capture_thrust * 17.0 / 27.87 * k**2
    )
    mass = np.linspace(54431.0, 136077.0, 7)
    ours = evaluate_fixed(small, make_variables(small, mass=mass * k**2))
    theirs = evaluate_fixed(full, make_variables(full, mass=mass))
    for field in ("inertia_xx", "inertia_yy", "inertia_zz", "inertia_13"):
        assert ours[field] == pytest.approx(theirs[field] * k**4, rel=1e-8)
    # GHAME's rule: from full to empty in proportion to the fuel spent.
    spent = (136077.0 - mass) / 81646.0
    assert theirs["inertia_yy"] == pytest.approx(31.6e6 + (19.25e6 - 31.6e6) * spent)


@pytest.mark.parametrize("name", ["ghame", "ghame_x", "ghame_x_coupled", "winged_cone"])
def test_shipped_vehicles_cause_no_warnings(repository, name):
    assert find_vehicle_warnings(load_vehicle(repository / f"configs/vehicle/{name}.yaml")) == []


def test_static_instability_in_pitch_causes_no_warning(repository):
    """The F-16 is unstable by design; the only warning is that it burns no fuel."""
    (warning,) = find_vehicle_warnings(load_vehicle(repository / "configs/vehicle/f16.yaml"))
    assert "mass.empty" in warning


def _with_drag(repository, change):
    """Return ghame_x with a changed drag table [Mach, angle of attack]."""
    file = read_vehicle_file(repository / "configs/vehicle/ghame_x.yaml")
    (term,) = file.content.aerodynamics.drag
    table = file.tables[term.table]
    axes = [axis.grid for axis in table.axes]
    drag = replace(table, values=change(table.values, *np.meshgrid(*axes, indexing="ij")))
    return pack_vehicle(replace(file, tables={**file.tables, term.table: drag}), PARAMETER_INDEX)


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (
            lambda drag, mach, alpha: drag - 0.05,
            r"at 37 of 117 nodes.* CD is -0\.0298 at Mach 24 and 3 deg",
        ),
        (
            lambda drag, mach, alpha: drag + 0.02 * np.cos(alpha * 60.0),
            r"minima, at -3 and 3 deg",  # 60 times this angle is half a turn
        ),
        (
            lambda drag, mach, alpha: 0.05 * drag,
            r"\blift-to-drag\b.* 45\.5 .*\bMach 24 and 21 deg.*= 6\.5 ",
        ),
    ],
)
def test_an_implausible_drag_causes_a_warning(repository, change, pattern):
    warnings = find_vehicle_warnings(_with_drag(repository, change))
    assert any(re.search(pattern, warning) for warning in warnings), warnings


@pytest.mark.parametrize(
    ("coefficient", "times", "factor", "pattern"),
    [
        ("yawing_moment", "sideslip", 180 / np.pi, "would be 0.30"),
        ("side_force", "sideslip", np.pi / 180, "would be -0.9"),
        (
            "pitching_moment",
            "pitch_rate",
            -1.0,
            r"\b2\.81 .*\bpitch rate\b",
        ),
        ("yawing_moment", "sideslip", -1.0, r"-0\.30.*\bunstable\b.*\byaw\b"),
        ("rolling_moment", "roll_rate", 180 / np.pi, "would be -0.1"),
    ],
)
def test_a_derivative_of_another_unit_or_sign_causes_a_warning_with_its_value(
    repository, coefficient, times, factor, pattern
):
    file = read_vehicle_file(repository / "configs/vehicle/ghame_x.yaml")
    terms = [
        term for term in getattr(file.content.aerodynamics, coefficient) if term.times == times
    ]
    scaled = {term.table: file.tables[term.table].scaled(factor) for term in terms}
    vehicle = pack_vehicle(replace(file, tables={**file.tables, **scaled}), PARAMETER_INDEX)
    (warning,) = find_vehicle_warnings(vehicle)
    assert re.search(pattern, warning), warning
