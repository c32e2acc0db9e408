"""Tests of the DAVE-ML import.

Files are compared with their check shots and with an independent evaluation of their graph.
"""

import ast
import copy
import re
import runpy
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from daveml.graph import Graph

from abhv_mc.io.documents import read_document
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc_daveml.graph import read_model
from abhv_mc_daveml.import_vehicle import ALTITUDES, import_daveml
from abhv_mc_daveml.writer import make_function, run_shots
from abhv_mc_vehicle.control.mission_tables import DENSITIES, read_air_table
from abhv_mc_vehicle.plant.trim import FlightPoint, trim
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.nesc_cases import ELLIPSOID

FILES = sorted((Path(__file__).parents[1] / "reference" / "daveml").glob("*.dml"))
SHOTS = {"F16_aero.dml": 16, "F16_prop.dml": 9}
RANGES = {  # of inputs in the files' units, beyond their tables
    "alpha": (-20.0, 55.0),
    "beta": (-40.0, 40.0),
    "vt": (0.0, 2000.0),
    "el": (-30.0, 30.0),
    "ALT": (-5e3, 6e4),
    "RMACH": (-0.2, 1.4),
    "PWR": (0.0, 100.0),
    "altCmd": (9e3, 1.1e4),
    "altMsl": (9e3, 1.1e4),
    "psi": (-180.0, 180.0),
    "baseChiCmd": (-180.0, 180.0),
    "ownshipN_deg": (-0.1, 90.0),
    "ownshipE_deg": (-180.0, 180.0),
    "Vequiv": (280.0, 295.0),
    "keasCmd": (280.0, 295.0),
    "stg1fuelUsed": (-1e4, 2e5),
    "stg2fuelUsed": (-1e4, 1e5),
}


def of(name):
    return next(path for path in FILES if path.name == name)


def changed(tmp_path, name, old, new):
    path = tmp_path / name
    text = of(name).read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_check_shots_pass_and_written_python_is_the_graph_at_random_inputs(path):
    model, graph = read_model(path), Graph(path)
    assert len(model.shots) == SHOTS.get(path.name, 0)
    run_shots(model)
    function, names = (
        make_function(model),
        {key: variable.key for key, variable in model.variables.items()},
    )
    assert {variable.identifier for variable in model.inputs} == set(graph.inputs)
    assert [variable.identifier for variable in model.outputs] != []
    rng = np.random.default_rng(19)
    points = 300 if graph.inputs else 1
    values = {name: rng.uniform(*RANGES.get(name, (-1.5, 1.5)), points) for name in graph.inputs}
    for i in range(points):
        inputs = {name: float(column[i]) for name, column in values.items()}
        ours = function(**{names[name]: value for name, value in inputs.items()})
        for name, value in graph.evaluate(inputs).items():
            assert getattr(ours, names[name]) == pytest.approx(value, rel=1e-12, abs=1e-12), (
                name,
                inputs,
            )


def test_aileron_of_the_other_sign_and_units_are_turned(tmp_path):
    import_daveml([of("F16_aero.dml"), of("F16_prop.dml"), of("F16_inertia.dml")], tmp_path)
    aero = runpy.run_path(str(tmp_path / "f16_aero.py"))

    air = SimpleNamespace(
        airspeed=152.4,
        angle_of_attack=np.radians(5.0),
        sideslip=np.radians(2.0),
        altitude=3000.0,
        mach=0.5,
    )
    rates = SimpleNamespace(roll_rate=0.01, pitch_rate=0.002, yaw_rate=-0.003)
    controls = SimpleNamespace(
        aileron=np.radians(4.0), rudder=np.radians(3.0), elevator=np.radians(-2.0)
    )
    ours = aero["coefficients"](air, controls, rates, None)
    inputs = {"vt": 500.0, "alpha": 5.0, "beta": 2.0, "el": -2.0, "ail": -4.0, "rdr": 3.0}
    inputs |= {"p": 0.01 * 2 * 500 / 30, "q": 0.002 * 2 * 500 / 11.32, "r": -0.003 * 2 * 500 / 30}
    theirs = Graph(of("F16_aero.dml")).evaluate(inputs)
    for name, output in (
        ("CX", "cx"),
        ("CY", "cy"),
        ("CZ", "cz"),
        ("Cl", "cl"),
        ("Cm", "cm"),
        ("Cn", "cn"),
    ):
        assert getattr(ours, name) == pytest.approx(theirs[output], rel=1e-10)
    engine = runpy.run_path(str(tmp_path / "f16_prop.py"))
    assert engine["thrust"](
        SimpleNamespace(altitude=0.0, mach=0.0), 0.5, None
    ).force_x == pytest.approx(12680.0 * 4.4482216152605)


SMALL = """<DAVEfunc><fileHeader name="small"/>
<variableDef name="angleOfSideslip" varID="beta" units="deg" sign="anr"><isInput/></variableDef>
<variableDef name="leftFlap" varID="DWFL" units="deg" sign="ted" initialValue="5"><isInput/>\
</variableDef>
<variableDef name="trueAirspeed" varID="v" units="f_s"><isInput/></variableDef>
<variableDef name="referenceWingArea" varID="s" units="f2" initialValue="100"><isOutput/>\
</variableDef>
<variableDef name="totalCoefficientOfLift" varID="CL" units="nd" sign="down"><calculation><math>\
<apply><plus/>
<cn>0.4</cn><ci>DWFL</ci></apply></math></calculation><isOutput/></variableDef>
<variableDef name="pitchingMomentCoefficient" varID="CM" units="nd" sign="and"><calculation><math>\
<ci>v</ci></math>
</calculation><isOutput/></variableDef>
<variableDef name="yawingMomentCoefficient" varID="CN" units="nd" sign="anl"><calculation><math>\
<ci>beta</ci></math>
</calculation><isOutput/></variableDef></DAVEfunc>"""


def imported(folder, text=SMALL, answers=""):
    """The coefficients of a file at a sideslip, airspeed and deflections."""
    (folder / "small.dml").write_text(text, encoding="utf-8")
    if answers:
        (folder / "import.yaml").write_text(answers, encoding="utf-8")
    import_daveml([folder / "small.dml"], folder)
    function = runpy.run_path(str(folder / "small.py"))["coefficients"]
    air = SimpleNamespace(sideslip=np.radians(2.0), airspeed=3.048)
    angles = {"aileron": 1.0, "rudder": 2.0, "elevator": 4.0, "left_flap": 8.0}
    controls = SimpleNamespace(**{name: np.radians(angle) for name, angle in angles.items()})
    return function(air, controls, None, None)


def test_signs_and_units_other_than_the_standards_are_turned(tmp_path):
    ours = imported(tmp_path)
    assert ours.CL == -5.4
    assert ours.Cm == pytest.approx(-10.0)  # ft/s
    assert ours.Cn == pytest.approx(2.0)
    with pytest.raises(InputError, match=r"small\.dml:\d+: 'CL'.*'sideways'"):
        imported(tmp_path, SMALL.replace('sign="down"', 'sign="sideways"'))


@pytest.mark.parametrize(
    ("answer", "flap"),
    [
        ("7", 7.0),
        ("elevator + aileron", 5.0),
        ("elevator - 0.5 aileron", 3.5),
        ("-rudder", -2.0),
        ("left_flap", 8.0),
    ],
)
def test_answers_are_numbers_and_sums_of_signals_and_effectors(answer, flap, tmp_path):
    effectors = "effectors: {left_flap: {elevator: 1, aileron: 1}}\n"
    ours = imported(tmp_path, answers=f"{effectors}small.dml:\n  DWFL: {answer}\n")
    assert pytest.approx(-0.4 - flap) == ours.CL


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ("small.dml: {DWFL: left}", "import.yaml:1:19: found 'left'; "),
        ("small.dml: {DWFL: elevator aileron}", "'elevator aileron'"),
        ("small.dml: {DWFL: airspeed}", " m/s"),
        ("small.dml: {DWFR: 1}", "import.yaml:1:13: unknown signal 'DWFR'"),
        ("other.dml: {DWFL: 1}", "import.yaml:1:1: unknown name 'other.dml'"),
    ],
)
def test_answers_that_make_no_sense_are_rejected(answers, message, tmp_path):
    with pytest.raises(InputError, match=re.escape(message)):
        imported(tmp_path, answers=answers)
    assert not (tmp_path / "small.py").exists()


def test_a_second_import_keeps_edits(tmp_path):
    files = [of("F16_aero.dml"), of("F16_prop.dml"), of("F16_inertia.dml")]
    first = import_daveml(files, tmp_path)
    assert first.shots == {"F16_aero.dml": 16, "F16_prop.dml": 9, "F16_inertia.dml": 0}
    vehicle = tmp_path / "vehicle.yaml"
    written = vehicle.read_text(encoding="utf-8")
    edited = written.replace("limit: 30 deg", "limit: 25 deg")
    vehicle.write_text(edited, encoding="utf-8")
    second = import_daveml(files, tmp_path)
    assert second.kept == (vehicle,) and vehicle.read_text(encoding="utf-8") == edited
    assert (tmp_path / "vehicle.new.yaml").read_text(encoding="utf-8") == written
    vehicle.write_text(written, encoding="utf-8")
    third = import_daveml(files, tmp_path)
    assert not third.kept and {*third.paths, tmp_path / "import.yaml"} == set(first.paths)


@pytest.mark.parametrize(("sign", "correlation"), [("anu", -0.5), ("and", 0.5)])
def test_uncertainties_become_dispersions_with_correlations(tmp_path, sign, correlation):
    def stated(effect, law):
        return f'<isOutput/><uncertainty effect="{effect}">{law}</uncertainty></variableDef>'

    lift = """<normalPDF numSigmas="3"><bounds>15</bounds>\
<correlation varID="CM" corrCoef="-0.5"/></normalPDF>"""
    laws = {
        "CL": stated("percentage", lift),
        "CM": stated("additive", '<normalPDF numSigmas="2"><bounds>0.01</bounds></normalPDF>'),
        "CN": stated(
            "multiplicative", "<uniformPDF><bounds>-0.2</bounds><bounds>0.2</bounds></uniformPDF>"
        ),
        "s": stated("additive", "<uniformPDF><bounds>1</bounds></uniformPDF>"),
    }
    text = SMALL
    for name, law in laws.items():
        start = text.index(f'varID="{name}"')
        text = text[:start] + text[start:].replace("<isOutput/></variableDef>", law, 1)
    imported(tmp_path, text.replace('"CM" units="nd" sign="and"', f'"CM" units="nd" sign="{sign}"'))
    written = (tmp_path / "dispersions.yaml").read_text(encoding="utf-8")
    assert re.search(r"(?m)^# .* of 's'\.$", written)  # not represented
    assert read_document(tmp_path / "dispersions.yaml").data == {
        "dispersions": {
            "aero.lift": {"distribution": "normal", "sigma": pytest.approx(0.05)},
            "aero.pitching_moment.increment": {"distribution": "normal", "sigma": 0.005},
            "aero.yawing_moment": {"distribution": "uniform", "half_width": 0.2},
        },
        "correlations": [
            {"between": ["aero.lift", "aero.pitching_moment.increment"], "normal": correlation}
        ],
    }


def test_variables_of_one_name_are_told_apart_by_units(tmp_path):
    path = tmp_path / "two.dml"
    path.write_text(
        """<DAVEfunc><fileHeader name="two"/><variableDef name="altitude" varID="h_f" units="f"/>
        <variableDef name="altitude" varID="h_m" units="m"><calculation><math><apply><times/>\
<ci>h_f</ci>
        <cn>0.3048</cn></apply></math></calculation><isOutput/></variableDef><checkData>\
<staticShot name="s">
        <checkInputs><signal><signalName>altitude</signalName><signalUnits>f</signalUnits><signalValue>10</signalValue>
        </signal></checkInputs><checkOutputs><signal><signalName>altitude</signalName><signalUnits>m</signalUnits>
        <signalValue>3.048</signalValue><tol>1e-9</tol></signal></checkOutputs></staticShot></checkData></DAVEfunc>""",
        encoding="utf-8",
    )
    run_shots(read_model(path))
    path.write_text(path.read_text().replace("3.048<", "3.05<"))
    with pytest.raises(InputErrors, match=r"'h_m'.*'s'"):
        run_shots(read_model(path))


def test_what_no_signal_gives_is_asked_for(tmp_path):
    files = [of("twostage_aero.dml"), of("twostage_inertia.dml"), of("twostage_prop.dml")]
    with pytest.raises(InputError, match=r"stagedFlag.*stg1firing"):
        import_daveml(files, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["import.yaml"]
    answers = tmp_path / "import.yaml"
    text = answers.read_text(encoding="utf-8")
    for name, value in (
        ("stagedFlag", 0),
        ("stg1fuelUsed", 0),
        ("stg2fuelUsed", 0),
        ("stg2firing", 0),
    ):
        text = text.replace(f'  "{name}":\n', f'  "{name}": {value}\n')
    answers.write_text(
        text.replace('  "stg1firing":\n', '  "stg1firing": throttle\n'), encoding="utf-8"
    )
    import_daveml(files, tmp_path)
    engine = runpy.run_path(str(tmp_path / "twostage_prop.py"))
    assert engine["thrust"](None, 1.0, None).force_x == 17e6
    assert engine["thrust"](None, 1.0, None).fuel_flow == pytest.approx(17e6 / (360 * 9.8066))
    assert engine["thrust"](None, 0.0, None).force_x == 0.0


@pytest.mark.parametrize(
    ("name", "old", "new", "problem"),
    [
        (
            "F16_aero",
            'DAVEfunc.dtd">',
            'DAVEfunc.dtd" [<!ENTITY a "b">]>',
            "'a'",
        ),
        ("F16_aero", "<cn>180.</cn>", "<cn>&amp;&other;</cn>", "entity"),
        ("F16_aero", "<ci>el</ci>", "<ci>__import__('os')</ci>", "unknown variable '__import__"),
        ("F16_aero", '<bpRef bpID="DE1"/>', '<bpRef bpID="DE9"/>', "unknown breakpoints 'DE9'"),
        ("F16_aero", "-.099,-.081", "-.099", "59 values"),
        ("F16_aero", "<cn>25.0</cn>", "<ci>cz</ci>", "circular"),
        ("F16_prop", "12680.0,  9150.0, 6200.0", "12690.0,  9150.0, 6200.0", "'FEX' is 12690.0"),
        ("brick_aero", 'units="ft_s"', 'units="furlong_s"', "unknown unit 'furlong_s'"),
    ],
)
def test_what_is_wrong_is_refused_with_its_line(tmp_path, name, old, new, problem):
    path = changed(tmp_path, f"{name}.dml", old, new)
    with pytest.raises(InputError, match=rf"{name}\.dml:\d+:.*{problem}"):
        import_daveml([path], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_ungridded_extrapolated_and_own_points(tmp_path):
    path = tmp_path / "small.dml"
    path.write_text(
        """<DAVEfunc><fileHeader name="small"/>
        <variableDef name="x" varID="x" units="nd"/><variableDef name="y" varID="y" units="nd"/>
        <variableDef name="f" varID="f" units="nd"><isOutput/></variableDef>
        <variableDef name="g" varID="g" units="nd"><isOutput/></variableDef>
        <variableDef name="h" varID="h" units="nd"><isOutput/></variableDef>
        <breakpointDef bpID="X"><bpVals>0 1 3</bpVals></breakpointDef>
        <function name="f"><independentVarRef varID="x"/><independentVarRef varID="y"/>\
<dependentVarRef varID="f"/>
          <functionDefn><ungriddedTableDef name="u" utID="u"><dataPoint>0 0 1</dataPoint>\
<dataPoint>2 0 3</dataPoint>
          <dataPoint>0 2 5</dataPoint><dataPoint>3 3 10</dataPoint></ungriddedTableDef>\
</functionDefn></function>
        <function name="g"><independentVarRef varID="x" min="0.5" max="3" extrapolate="max"/>
          <dependentVarRef varID="g"/><functionDefn><griddedTableDef name="t" gtID="t">
          <breakpointRefs><bpRef bpID="X"/></breakpointRefs><dataTable>0 2 4</dataTable>\
</griddedTableDef>
          </functionDefn></function>
        <function name="h"><independentVarPts varID="x">0 1</independentVarPts>
          <dependentVarPts varID="h">1 3</dependentVarPts></function></DAVEfunc>""",
        encoding="utf-8",
    )
    function = make_function(read_model(path))
    assert function(0.5, 0.5) == pytest.approx((1 + 0.5 + 1.0, 1.0, 2.0))  # f = 1 + x + 2 y
    assert function(5.0, 0.0)[1:] == pytest.approx((6.0, 3.0))
    assert function(-5.0, 0.0)[1:] == pytest.approx((1.0, 1.0))


def formula(tmp_path, text):
    """A formula of x and y as a function."""
    path = tmp_path / "formula.dml"
    path.write_text(
        f"""<DAVEfunc><fileHeader name="formula"/><variableDef name="x" varID="x" units="nd"/>
        <variableDef name="y" varID="y" units="nd"/><variableDef name="f" varID="f" units="nd">\
<calculation><math>{text}
        </math></calculation><isOutput/></variableDef></DAVEfunc>""",
        encoding="utf-8",
    )
    return make_function(read_model(path))


ROOT = (
    "<apply><root/><degree>{}</degree><apply><max/><ci>x</ci><ci>y</ci><cn>0.5</cn></apply></apply>"
)
POSITIVE = "<apply><gt/><ci>x</ci><cn>0</cn></apply>"


def pieces(number):
    below = (
        f"<piece><cn>{i}</cn><apply><lt/><ci>x</ci><cn>{i}</cn></apply></piece>"
        for i in range(number)
    )
    return f"<piecewise>{''.join(below)}<otherwise><cn>-1</cn></otherwise></piecewise>"


@pytest.mark.parametrize(
    ("text", "x", "expected"),
    [
        (ROOT.format("<cn>3</cn>"), 5.0, 5.0 ** (1 / 3)),
        (f"<apply><xor/>{3 * POSITIVE}</apply>", 1.0, 1.0),  # of an odd number
        (f"<apply><xor/>{2 * POSITIVE}</apply>", 1.0, 0.0),
        (pieces(199), 5.5, 6.0),
        (pieces(199), 1e9, -1.0),
    ],
)
def test_formulas_are_what_mathml_says(tmp_path, text, x, expected):
    assert formula(tmp_path, text)(x, 0.0).f == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "problem"),
    [(ROOT.format("<cn>3</cn><cn>2</cn>"), "'root' has 3 operands"), (pieces(2000), "too deep")],
)
def test_a_formula_that_is_none_is_refused(tmp_path, text, problem):
    with pytest.raises(InputError, match=problem):
        formula(tmp_path, text)


def test_tables_of_one_name_and_a_variable_of_theirs_keep_their_own_numbers(tmp_path):
    function = """<variableDef name="{0}" varID="{0}" units="nd"><isOutput/></variableDef>\
<function name="{0}">
        <independentVarRef varID="x"/><dependentVarRef varID="{0}"/><functionDefn>\
<griddedTableDef name="same_table">
        <breakpointRefs><bpRef bpID="X"/></breakpointRefs><dataTable>0 {1}</dataTable>\
</griddedTableDef>
        </functionDefn></function>"""
    path = tmp_path / "same.dml"
    path.write_text(
        """<DAVEfunc><fileHeader name="same"/><variableDef name="x" varID="x" units="nd"/>
        <variableDef name="c" varID="same_table" units="nd" initialValue="7"><isOutput/>\
</variableDef>
        <breakpointDef bpID="X"><bpVals>0 1</bpVals></breakpointDef>"""
        + "".join(function.format(name, i + 1) for i, name in enumerate("abcd"))
        + "</DAVEfunc>",
        encoding="utf-8",
    )
    assert sorted(make_function(read_model(path))(1.0)) == [1.0, 2.0, 3.0, 4.0, 7.0]


ODD = """<DAVEfunc xmlns="http://daveml.org/2010/DAVEML" xmlns:m="http://www.w3.org/1998/Math/MathML">
<fileHeader name="odd"><provenance provID="p"><author name="a" org="b"/></provenance></fileHeader>
<variableDef name="angleOfAttack" varID="class" units="DEG"/>
<variableDef name="scale" varID="1k" units="nd" initialValue="2.5"><provenanceRef provID="p"/>\
<uncertainty
 effect="additive"><normalPDF numSigmas="3"><bounds>0.1</bounds></normalPDF></uncertainty>\
</variableDef>
<variableDef name="between" varID="between" units="nd"><calculation><m:math><m:apply><m:times/>\
<m:ci>1k</m:ci>
 <m:cn type="e-notation">4<m:sep/>-1</m:cn></m:apply></m:math></calculation></variableDef>
<variableDef name="angle" varID="angle" units="rad"><calculation><m:math><m:apply>
 <m:csymbol definitionURL="http://daveml.org/function_spaces.html#atan2"/><m:ci>class</m:ci>
 <m:apply><m:minus/><m:ci>between</m:ci></m:apply></m:apply></m:math></calculation><isOutput/></variableDef>
<checkData><staticShot name="one"><checkInputs><signal><signalName>angleOfAttack</signalName>
 <signalUnits>rad</signalUnits><signalValue>0.017453292519943295</signalValue></signal></checkInputs><internalValues><signal><varID>between</varID>
 <signalValue>1.0</signalValue><tol>1e-9</tol></signal></internalValues><checkOutputs><signal><varID>angle</varID>
 <signalValue>2.356194490192345</signalValue><tol>1e-9</tol></signal></checkOutputs></staticShot></checkData></DAVEfunc>"""


def test_units_in_capitals_numbers_with_exponents_and_internal_values(tmp_path):
    path = tmp_path / "odd.dml"
    path.write_text(ODD, encoding="utf-8")
    run_shots(read_model(path))
    path.write_text(
        ODD.replace('"e-notation">4<m:sep/>-1<', '"rational">2<m:sep/>5<'), encoding="utf-8"
    )
    run_shots(read_model(path))
    path.write_text(ODD.replace("<signalValue>1.0<", "<signalValue>1.1<"), encoding="utf-8")
    with pytest.raises(InputErrors, match=r"'between'.*'one'"):
        run_shots(read_model(path))


def test_limits_are_where_the_tables_end_and_without_them_the_trim_is_near_zero(tmp_path):
    import_daveml([of("F16_aero.dml"), of("F16_prop.dml"), of("F16_inertia.dml")], tmp_path)
    path = tmp_path / "vehicle.yaml"
    limited = load_vehicle(path).constants
    assert np.degrees([limited.angle_of_attack_min, limited.angle_of_attack_max]).tolist() == [
        -10.0,
        45.0,
    ]
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("\nlimits:")], encoding="utf-8")
    trimmed = trim(load_vehicle(path), ELLIPSOID, FlightPoint(3051.96, 172.42))
    assert not trimmed.fault
    assert 1.0 < np.degrees(trimmed.angle_of_attack) < 4.0


HOSTILE = (
    "x\nimport hostile\n    import hostile\n\"\"\"\nimport hostile\n'''\nhostile() # "
    "\u202e\u2028file: hostile.py\\"
)
WRITTEN = (ast.ImportFrom, ast.Assign, ast.ClassDef, ast.FunctionDef)
KEYS = {  # of the files of YAML that are written, by what names them
    "vehicle.yaml": "name reference mass surfaces aerodynamics propulsion limits",
    "import.yaml": "file.dml",
    "dispersions.yaml": "dispersions correlations",
    "file.yaml": "law file rate commands",
}


def attacked(tree):
    """Return the file with hostile text in place of, and behind, its attributes and texts.

    Each kind is changed once, at its first occurrence in each element.
    """
    seen = set()
    for index, element in enumerate(tree.iter()):
        for key in [*element.attrib, ""]:
            kind = key, element.tag, *(child.tag for child in element)
            if kind in seen or not (key or (element.text or "").strip()):
                continue
            seen.add(kind)
            for before in ("", element.get(key) if key else element.text):
                changed = copy.deepcopy(tree)
                target = list(changed.iter())[index]
                if key:
                    target.set(key, before + HOSTILE)
                else:
                    target.text = before + HOSTILE
                yield changed


SLOW = [
    pytest.param(f"F16_{name}.dml", marks=pytest.mark.thorough) for name in ("inertia", "control")
]


@pytest.mark.parametrize("name", ["F16_prop.dml", "brick_aero.dml", "odd.dml", *SLOW])
def test_hostile_text_never_becomes_code(tmp_path, name):
    odd = ODD.replace('units="DEG"', 'units="DEG" initialValue="1"')
    text = odd if name == "odd.dml" else of(name).read_text(encoding="utf-8")
    accepted = 0
    for i, tree in enumerate(attacked(ElementTree.fromstring(text))):
        folder = tmp_path / str(i)
        folder.mkdir()
        path = folder / "file.dml"
        path.write_bytes(ElementTree.tostring(tree))
        try:
            import_daveml([path], folder)
            accepted += 1
        except InputError:
            pass
        for written in folder.glob("*.py"):
            module = ast.parse(written.read_text(encoding="utf-8"))
            assert all(isinstance(node, WRITTEN) for node in module.body[1:])
            imports = [
                node for node in ast.walk(module) if isinstance(node, ast.Import | ast.ImportFrom)
            ]
            assert {getattr(node, "module", "") for node in imports} <= {
                "math",
                "typing",
                "abhv_mc.extend",
            }
            assert not any(
                isinstance(node, ast.Name) and node.id == "hostile" for node in ast.walk(module)
            )
        for written in folder.glob("*.yaml"):
            data = read_document(written).data
            assert set(data) <= set(KEYS[written.name].split())
            assert data.get("file", "file.py") == "file.py"
    assert accepted > 10


ATMOSPHERE = """<DAVEfunc><fileHeader name="air"/>
<variableDef name="geometricAltitude" varID="altMSL" units="f"><isInput/></variableDef>
<variableDef name="radius" varID="R0" units="f" initialValue="20855531.5"/>
<variableDef name="geopotentialAltitude" varID="H" units="f"><calculation><math><apply><divide/>
<apply><times/><ci>R0</ci><ci>altMSL</ci></apply><apply><plus/><ci>R0</ci><ci>altMSL</ci></apply>
</apply></math></calculation></variableDef>
<variableDef name="temperature" varID="T" units="d_R"><calculation><math><piecewise>
<piece><apply><minus/><cn>518.67</cn><apply><times/><cn>0.00356616</cn><ci>H</ci></apply></apply>
<apply><lt/><ci>H</ci><cn>36089.24</cn></apply></piece>
<otherwise><cn>389.97</cn></otherwise></piecewise></math></calculation><isOutput/></variableDef>
<variableDef name="delta" varID="delta" units="nd"><calculation><math><piecewise>
<piece><apply><power/><apply><divide/><ci>T</ci><cn>518.67</cn></apply><cn>5.2558797</cn></apply>
<apply><lt/><ci>H</ci><cn>36089.24</cn></apply></piece>
<otherwise><apply><times/><cn>0.2233609</cn><apply><exp/><apply><divide/>
<apply><minus/><cn>36089.24</cn><ci>H</ci></apply><cn>20805.7</cn></apply></apply></apply></otherwise>
</piecewise></math></calculation></variableDef>
<variableDef name="airDensity" varID="rho" units="slug_f3"><calculation><math><apply><divide/>
<apply><times/><cn>0.0023768908</cn><ci>delta</ci><cn>518.67</cn></apply><ci>T</ci></apply></math>
</calculation><isOutput/></variableDef>
<variableDef name="ambientPressure" varID="p" units="lbf_f2"><calculation><math><apply><times/>
<cn>2116.2166</cn><ci>delta</ci></apply></math></calculation><isOutput/></variableDef></DAVEfunc>"""


@pytest.mark.parametrize("output", ["density and pressure", "density"])
def test_a_model_of_the_atmosphere_becomes_the_air_profile_of_a_mission(output, tmp_path):
    text = ATMOSPHERE if "pressure" in output else ATMOSPHERE.replace("ambientP", "other")
    (tmp_path / "air.dml").write_text(text, encoding="utf-8")
    written = import_daveml([tmp_path / "air.dml"], tmp_path / "out").paths
    assert [path.name for path in written] == ["air.csv", "air.py"]
    rows = read_air_table(tmp_path / "out/air.csv", DENSITIES, {})
    assert rows[:, 0].tolist() == ALTITUDES.tolist()
    layers = rows[:, 0] <= 20_000.0  # the model's upper layer is isothermal
    np.testing.assert_allclose(rows[layers, 1:], 1.0, rtol=1e-4)
    model = read_model(tmp_path / "air.dml")
    function, graph = make_function(model), Graph(tmp_path / "air.dml")
    for feet in np.linspace(0.0, 2e5, 300).tolist():
        assert function(feet) == pytest.approx(
            tuple(graph.evaluate({"altMSL": feet}).values()), rel=1e-12
        )


@pytest.mark.parametrize("unit", ["dgF", "dgC", "dgR", "dgK"])
def test_an_atmosphere_may_give_pressure_and_temperature_in_place_of_density(unit, tmp_path):
    """NASA's atmos_76.dml has a density ratio, a pressure, and temperatures in dgC and dgF."""
    rankine = {
        "dgR": "<ci>T</ci>",
        "dgF": "<apply><minus/><ci>T</ci><cn>459.67</cn></apply>",
        "dgC": "<apply><minus/><apply><divide/><ci>T</ci><cn>1.8</cn></apply>"
        "<cn>273.15</cn></apply>",
        "dgK": "<apply><divide/><ci>T</ci><cn>1.8</cn></apply>",
    }
    output = (
        f'<variableDef name="AmbientTemperature" varID="t_amb" units="{unit}"><calculation><math>'
        f"{rankine[unit]}</math></calculation><isOutput/></variableDef></DAVEfunc>"
    )
    text = ATMOSPHERE.replace("airDensity", "RatioOfDensity").replace("</DAVEfunc>", output)
    (tmp_path / "air.dml").write_text(text, encoding="utf-8")
    import_daveml([tmp_path / "air.dml"], tmp_path / "out")
    rows = read_air_table(tmp_path / "out/air.csv", DENSITIES, {})
    layers = rows[:, 0] <= 20_000.0
    np.testing.assert_allclose(rows[layers, 1:], 1.0, rtol=1e-4)
    (tmp_path / "air.dml").write_text(text.replace(f'"{unit}"', '"furlong"'), encoding="utf-8")
    with pytest.raises(InputError, match="temperature"):
        import_daveml([tmp_path / "air.dml"], tmp_path / "other")


def test_an_atmosphere_without_density_at_an_altitude_is_rejected(tmp_path):
    text = ATMOSPHERE.replace("<exp/>", "<ln/>")
    (tmp_path / "air.dml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"air\.dml.*density.* \d+ m\b"):
        import_daveml([tmp_path / "air.dml"], tmp_path / "out")
    assert not (tmp_path / "out").exists()
