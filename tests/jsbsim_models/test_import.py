"""Tests of the import of small JSBSim models."""

import re
import runpy
from types import SimpleNamespace

import numpy as np
import pytest
from programs import invoke

from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError
from abhv_mc.io.units import parse_any
from abhv_mc_jsbsim.import_vehicle import import_jsbsim

SMALL = """<fdm_config name="small"><metrics>
<wingarea unit="M2">10</wingarea><wingspan unit="M">4</wingspan><chord unit="M">2</chord>
<location name="AERORP" unit="M"><x>5</x><y>0</y><z>1</z></location></metrics>
<mass_balance><ixx unit="KG*M2">100</ixx><iyy unit="KG*M2">400</iyy><izz unit="KG*M2">450</izz>
<emptywt unit="KG">1000</emptywt><location name="CG" \
unit="M"><x>4</x><y>0</y><z>1</z></location></mass_balance>
<ground_reactions><contact name="Skid"/></ground_reactions>
<propulsion><engine file="rocket"><thruster file="nozzle"/></engine></propulsion>
<aerodynamics>{}</aerodynamics></fdm_config>"""


def written(folder, aerodynamics):
    """Return the coefficients of a small model at a point, and the result of its import."""
    path = folder / "small.xml"
    path.write_text(SMALL.format(aerodynamics), encoding="utf-8")
    imported = import_jsbsim(path, folder)
    names = runpy.run_path(str(folder / "aerodynamics.py"))
    air = SimpleNamespace(
        altitude=3048.0,
        mach=0.5,
        density=1.0,
        pressure=1e5,
        sound_speed=320.0,
        dynamic_pressure=5000.0,
        airspeed=100.0,
        angle_of_attack=0.1,
        sideslip=-0.05,
    )
    rates = SimpleNamespace(roll_rate=0.01, pitch_rate=0.02, yaw_rate=0.03)
    controls = SimpleNamespace(aileron=0.1, rudder=0.2, elevator=-0.3)
    values = read_document(folder / "vehicle.yaml").data["aerodynamics"].get("settings", {})
    settings = SimpleNamespace(**values)
    return names["coefficients"](air, controls, rates, settings), imported


def lift(element):
    return (
        '<axis name="LIFT"><function name="aero/CL"><product><property>aero/qbar-psf</property>'
        f"<property>metrics/Sw-sqft</property>{element}</product></function></axis>"
    )


@pytest.mark.parametrize(
    ("element", "value"),
    [
        ("<property>-aero/alpha-deg</property>", -np.degrees(0.1)),
        ("<sum><value>1</value><p>aero/beta-rad</p><v>2</v></sum>", 2.95),
        ("<difference><value>1</value><value>0.25</value><value>0.25</value></difference>", 0.5),
        ("<quotient><value>1</value><p>aero/alpha-rad</p></quotient>", 10.0),
        ("<pow><p>aero/beta-rad</p><value>2</value></pow>", 0.0025),
        ("<pow><p>aero/alpha-rad</p><value>0.5</value></pow>", 0.1**0.5),
        ("<abs><p>aero/beta-rad</p></abs>", 0.05),
        ("<sin><p>aero/alpha-rad</p></sin>", np.sin(0.1)),
        ("<atan><p>velocities/mach</p></atan>", np.arctan(0.5)),
        ("<max><value>1</value><value>3</value><value>2</value></max>", 3.0),
        ("<ifthen><lt><p>velocities/mach</p><value>1</value></lt><v>2</v><v>3</v></ifthen>", 2.0),
        ("<toradians><value>180</value></toradians>", np.pi),
        ("<avg><value>1</value><value>2</value></avg>", 1.5),
        ("<property>aero/bi2vel</property><property>velocities/p-rad_sec</property>", 0.01),
        ("<property>velocities/q-aero-rad_sec</property>", 0.02 * 2 * 100 / 2),
        ("<property>position/h-sl-ft</property>", 10000.0),
        ("<property>fcs/elevator-pos-norm</property>", -0.3 / np.radians(30)),
    ],
)
def test_elements_have_the_right_values(element, value, tmp_path):
    ours, _ = written(tmp_path, lift(element))
    assert pytest.approx(value, rel=1e-12) == ours.CL


def test_blocks_of_three_axis_tables_may_have_different_breakpoints(tmp_path):
    table = """<table><independentVar lookup="row">velocities/mach</independentVar>
    <independentVar lookup="column">aero/alpha-rad</independentVar>
    <independentVar lookup="table">gear/gear-pos-norm</independentVar>
    <tableData breakPoint="0">
        0.0 0.2
    0.0 1.0 3.0
    1.0 5.0 9.0
    </tableData><tableData breakPoint="1">
        0.0 0.1 0.3
    0.4 0.0 1.0 2.0
    </tableData></table>"""
    ours, imported = written(tmp_path, lift(table))
    assert ours.CL == 4.5
    assert imported.settings == ("gear/gear-pos-norm",)
    path = tmp_path / "vehicle.yaml"
    path.write_text(path.read_text().replace("gear_pos_norm: 0.0", "gear_pos_norm: 0.25"))
    ours, imported = written(tmp_path, lift(table))
    assert imported.kept == (path,)
    assert ours.CL == 0.75 * 4.5 + 0.25 * 1.0


def test_a_function_that_is_not_a_product_is_divided(tmp_path):
    ours, _ = written(
        tmp_path,
        '<function name="aero/q"><p>aero/qbar-psf</p></function><axis name="PITCH">'
        '<function name="M"><sum><product><p>aero/q</p>'
        "<value>7</value></product></sum></function></axis>" + lift("<value>2</value>"),
    )
    assert ours.Cm == pytest.approx(7.0 / (10 * 2) * 0.3048**3)
    assert ours.CL == 2.0


def test_parts_that_are_left_out_are_listed(tmp_path):
    rate = "<property>aero/alphadot-rad_sec</property><value>3</value>"
    _, imported = written(tmp_path, "<alphalimits/>" + lift(rate))
    named = (r"\bSkid$", r"^engine .*\brocket\b.*\bnozzle$", r"\bangle of attack$")
    named += (r"^aero/alphadot-rad_sec\b.*\baero/CL\b.*\b0$",)
    named += (r"\baileron\b", r"\brudder\b", r"\belevator\b")
    for pattern, note in zip(named, imported.left_out, strict=True):
        assert re.search(pattern, note)
    text = (tmp_path / "vehicle.yaml").read_text()
    assert all(f"# - {note}\n" in text for note in imported.left_out)


def test_the_command_lists_left_out_parts_and_rejects_other_files(tmp_path):
    path = tmp_path / "small.xml"
    path.write_text(SMALL.format(lift("<p>fcs/flap-pos-deg</p>")), encoding="utf-8")
    command = ["import", "jsbsim", path, "-o", tmp_path / "made"]
    result = invoke(*command)
    assert "fcs/flap-pos-deg" in result.stdout
    assert re.search(r": engine .*\brocket\b.*\bnozzle$", result.stdout, re.MULTILINE)
    path.write_text("<vehicle/>", encoding="utf-8")
    assert "'vehicle'" in str(invoke(*command).exception)


def test_the_angle_of_attack_is_limited_where_the_lift_falls(tmp_path):
    table = """<table><independentVar>aero/alpha-deg</independentVar>
    <tableData>-90 0\n-10 -0.8\n15 1.4\n90 0</tableData></table>"""
    written(tmp_path, lift(table))
    limits = read_document(tmp_path / "vehicle.yaml").data["limits"]
    assert limits["angle_of_attack"] == ["-10 deg", "15 deg"]


def test_mass_and_positions_are_converted_to_body_axes(tmp_path):
    written(tmp_path, lift("<value>1</value>"))
    point = read_document(tmp_path / "vehicle.yaml").data["mass"]["points"][0]
    values = {name: parse_any(text) for name, text in point.items()}
    assert values["mass"] == 1000.0
    assert values["center_of_gravity_x"] == pytest.approx(1.0)
    assert values["inertia_yy"] == pytest.approx(400.0)


@pytest.mark.parametrize(
    ("aerodynamics", "message"),
    [
        (lift("<random/>"), "'random'"),
        (lift("<pow><value>1</value></pow>"), r"'pow'.*\b1\b"),
        (lift("<table><independentVar>velocities/mach</independentVar>"
              "<tableData>1 2\n1 3</tableData></table>"), "breakpoints"),
        (lift("<table><independentVar>velocities/mach</independentVar>"
              "<tableData>1 2\n3</tableData></table>"), "1 or 2 numbers"),
        ('<axis name="THRUST"/>', r"\bTHRUST\b"),
        ('<function name="a"><p>b</p></function><function name="b"><p>a</p></function>'
         + lift("<p>a</p>"), "itself"),
    ],
)  # fmt: skip
def test_unsupported_content_is_rejected_with_its_line(aerodynamics, message, tmp_path):
    with pytest.raises(InputError, match=rf"small.xml:\d+.*{message}"):
        written(tmp_path, aerodynamics)
    assert not (tmp_path / "vehicle.yaml").exists()
