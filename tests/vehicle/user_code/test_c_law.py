"""Control laws in C: same results as built-in laws; violations are rejected by name."""

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest
from short_flights import assert_same, disperse, short_plan
from vehicle.user_code.test_user_law import CASCADE

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp, sincos, wrap
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.stability.analysis import analyse
from abhv_mc_vehicle.stability.linearize import linearize
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.user_code.law_source import make_header, make_settings_header
from abhv_mc_vehicle.vehicle_simulator.make_plans import describe_end

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

HEAD = """\
#include "abhv_law.h"
#include "gain.h"
typedef struct { double speed, *at; long ticks; } memory;  \
/* points into itself, as Simulink's coder writes it */
size_t abhv_law_state_size(void) { return sizeof(memory); }
"""
INIT = """\
int abhv_law_init(const abhv_settings *s, const abhv_reference *first, void *state) {
    (void)s, (void)first, ((memory *)state)->at = &((memory *)state)->speed;
    return 0;
}
"""
STEP = """\
int abhv_law_step(const abhv_measured *m, const abhv_reference *r, const double *k, \
const abhv_settings *s,
                  double time, double dt, void *state, abhv_command *c) {
    memory *own = state;
    (void)k, (void)time;
    %s
    double alpha = r->angle_of_attack - s->path[1] * (m->flight_path_angle - r->flight_path_angle);
    double bank = abhv_wrap(m->bank - r->bank) + 0.01 * (m->mach - 6.0) + 0.1 * m->pitch \
+ 1e-5 * m->cross_track;
    bank += 1e-3 * m->acceleration_y;
    c->equivalence_ratio = r->equivalence_ratio - 0.02 * (m->speed - r->speed) - gain() * *own->at;
    c->elevator = r->elevator + 2.0 * (m->angle_of_attack - alpha) + 1.5 * m->pitch_rate;
    c->aileron = -0.26 * bank - 1.2 * m->sideslip - 0.08 * m->roll_rate + 0.06 * m->yaw_rate;
    c->rudder = -0.04 * bank - 0.2 * m->sideslip - 0.01 * m->roll_rate + 0.04 * m->yaw_rate;
    c->angle_of_attack = alpha;
    own->speed += dt * (m->speed - r->speed);
    own->ticks += 1;
    return 0;
}
"""
GET_SET = """\
int abhv_law_state_get(const void *state, double *values) {
    if (values) values[0] = ((const memory *)state)->speed, \
values[1] = (double)((const memory *)state)->ticks;
    return 2;
}
int abhv_law_state_set(void *state, const double *values) {
    ((memory *)state)->speed = values[0], ((memory *)state)->ticks = (long)values[1];
    return 0;
}
"""
PLAIN = HEAD + INIT + STEP % "" + GET_SET
BANK = "wrap(measured.bank - reference.bank)"
MORE = f"{BANK} + 0.01 * (measured.mach - 6.0) + 0.1 * measured.pitch + 1e-5 * measured.cross_track"
MORE += " + 1e-3 * measured.acceleration_y"
PYTHON = CASCADE.format(compiled="").replace(BANK, MORE)


GAIN = '#include "gain.h"\ndouble gain(void) { return 0.001; }\n'


@pytest.fixture
def make(tmp_path):
    """Return a plan of a C law's text for some seconds of level flight."""
    (tmp_path / "gain.h").write_text("double gain(void);\n")
    (tmp_path / "gain.c").write_text(GAIN)

    def make_plan(text, seconds=1.0):
        if text.startswith("from"):
            (tmp_path / "law.py").write_text(text)
            (tmp_path / "law.yaml").write_text("law: python\nfile: law.py\n")
        else:
            (tmp_path / "law.c").write_text(text)
            settings = "settings: {path: [0.5, 90 %], limit: 60 deg}"
            (tmp_path / "law.yaml").write_text(
                f'law: c\nsources: [law.c, gain.c]\nfiles: ["*.h"]\n{settings}\n'
            )
        return short_plan(round(seconds * 100), tmp_path / "law.yaml", "level")

    return make_plan


def test_lqr_in_c_is_the_built_in_lqr_to_the_bit_and_has_its_margins(repository):
    laws = str(repository / "configs/control/lqr_c/lqr_c.yaml"), "lqr"
    mine, built_in = (make_flight_plan("s_manoeuvre", "ghame_x_coupled", law) for law in laws)
    parameters = disperse(70)
    assert_same(fly(mine, parameters, 50), fly(built_in, parameters, 50))
    some = nominal_parameters(2)
    some[1, PARAMETER_INDEX["aero.lift"]] = 1.05
    ours, theirs = (
        linearize(plan, flown_points(plan, some, 40.0).points) for plan in (mine, built_in)
    )
    assert np.abs(ours.law_D[..., :10] - theirs.law_D).max() < 1e-6 * np.abs(theirs.law_D).max()
    assert np.array_equal(ours.A, theirs.A) and np.abs(ours.law_D[..., 10:]).max(initial=0.0) < 1e-9
    margins, expected = (analyse(linear).margins for linear in (ours, theirs))
    for name, actual, other in zip(margins._fields, margins, expected, strict=True):
        np.testing.assert_allclose(actual, other, rtol=1e-6, err_msg=name)


def test_a_law_with_a_state_does_not_depend_on_lanes_company_or_compaction_and_is_linearised(make):
    """A version in plain Python behaves identically."""
    seconds = 5.5  # past a compaction
    plan, python = make(PLAIN, seconds), make(PYTHON, seconds)
    parameters = disperse(300)  # more than share a compaction
    abreast = fly(plan, parameters, 100)
    assert 0 < (abreast.outcome != Outcome.OK).sum() < len(parameters)
    assert_same(abreast, fly(python, parameters, 100))
    order = np.random.default_rng(1).permutation(len(parameters))
    assert np.array_equal(
        abreast.metrics[order], fly(plan, parameters[order]).metrics, equal_nan=True
    )
    some = [0, 40, 299]
    assert np.array_equal(
        abreast.metrics[some], fly(plan, parameters[some]).metrics, equal_nan=True
    )
    ours, theirs = (
        linearize(law_plan, flown_points(law_plan, parameters[1:3], 1.0).points)
        for law_plan in (plan, python)
    )
    assert np.abs(ours.law_D[..., 10:]).max() > 1e-3
    np.testing.assert_allclose(ours.law_D, theirs.law_D, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.law_C, theirs.law_C, rtol=0, atol=1e-9)
    assert np.array_equal(
        ours.law_A[..., :1, :1], theirs.law_A[..., :1, :1]
    )  # of the speed; ticks are whole in C


def test_memory_that_is_not_given_is_refused_by_name_where_slopes_are_taken(make):
    plan = make(HEAD + INIT + STEP % "")
    with pytest.raises(InputError, match="abhv_law_state_get"):
        flown_points(plan, nominal_parameters(), 0.5)


def test_a_law_that_returns_an_error_or_no_number_ends_its_flight(make):
    failing = make(HEAD + INIT + STEP % "if (m->bank > 0.35 && own->ticks == 3) return 1;")
    parameters = nominal_parameters(3)
    parameters[1, PARAMETER_INDEX["initial.bank"]] = 0.4
    block = fly(failing, parameters)
    assert [Outcome(code) for code in block.outcome] == [Outcome.OK, Outcome.LAW_FAILED, Outcome.OK]
    assert block.end_time[1] == pytest.approx(0.03)
    plan = make(HEAD + INIT + STEP % "dt = own->ticks == 30 ? 0.0 / 0.0 : dt;")
    block = fly(plan, parameters)
    assert {Outcome(code) for code in block.outcome} == {Outcome.NOT_FINITE}
    ended = describe_end(plan, parameters[:1], Outcome.NOT_FINITE)
    assert re.search(r"\(equivalence_ratio_command\) .*\b0\.31 s\.$", ended)


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        ("dt = 0.0 / 0.0;", "the throttle command is not finite at 0.01 s"),
        (
            "if (own->ticks == 0) return 1;",
            "at 0 s ",
        ),
    ],
)
def test_a_law_that_fails_at_its_first_ticks_is_rejected_with_its_line(
    make, tmp_path, fault, problem
):
    text = HEAD + INIT + STEP % fault
    with pytest.raises(InputError) as caught:
        make(text)
    assert problem in caught.value.found, str(caught.value)
    line = text[: text.index("int abhv_law_step")].count("\n") + 1
    assert (caught.value.file, caught.value.line) == (str(tmp_path / "law.c"), line)


REFUSED = {
    "memory": PLAIN.replace(
        "double alpha =", "static double x; x += m->bank;\n    double alpha = x +"
    ),
    "31, at 0.31 s": PLAIN.replace(
        "own->ticks += 1;", "own->ticks += 1; if (own->ticks == 32) *(volatile int *)0 = 1;"
    ),
    "(expected": PLAIN.replace("return 2;", "return 2"),
    "(helper.h: ": '#include "helper.h"\n' + PLAIN,
    "abhv_law_state_get": PLAIN.replace("abhv_law_state_set", "another_name"),
    "abhv_law_step": PLAIN.replace("abhv_law_step", "another_name"),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_no_law_is_refused_in_words(make, message):
    with pytest.raises(InputError) as refused:
        make(REFUSED[message])
    assert message in refused.value.found, refused.value
    if message.startswith("(expected"):
        assert (
            refused.value.line
            == REFUSED[message][: REFUSED[message].index("return 2\n")].count("\n") + 1
        )
    if message.startswith("(helper.h"):
        assert refused.value.expected.startswith("'files: [helper.h]'")


@pytest.mark.parametrize(
    ("value", "units", "message", "line"),
    [
        ("70", "bank_limit: rad", "70", 3),
        ("70 m", "bank_limit: rad", "a length", 3),
        ("70 deg", "bank_limit: deg", "'deg'", 4),
        ("70 deg", "bank_limit: rads", "unknown unit 'rads'", 4),
        ("70 deg", "bank: rad", "'units' names 'bank'", 4),
    ],
)
def test_a_setting_has_the_unit_that_its_file_declares(tmp_path, value, units, message, line):
    (tmp_path / "law.c").touch()
    text = "law: c\nsources: [law.c]\nsettings: {{bank_limit: {}}}\nunits: {{{}}}\n"
    (tmp_path / "law.yaml").write_text(text.format(value, units))
    with pytest.raises(InputErrors) as refused:
        read_controller(tmp_path / "law.yaml")
    assert [(message in error.found, error.line) for error in refused.value.errors] == [
        (True, line)
    ]
    (tmp_path / "law.yaml").write_text(text.format("70 deg", "bank_limit: rad"))
    assert read_controller(tmp_path / "law.yaml").numbers == [pytest.approx(np.radians(70.0))]


def build(folder, text, layout, name, *flags):
    """Build the library as a user's own Makefile would."""
    (folder / "abhv_law.h").write_text(make_header())
    (folder / "abhv_settings.h").write_text(make_settings_header(layout))
    (folder / f"{name}.c").write_text(text)
    command = [
        "cc",
        "-shared",
        "-fPIC",
        "-O2",
        "-ffp-contract=off",
        "-I.",
        "-o",
        f"{name}.so",
        f"{name}.c",
        *flags,
    ]
    subprocess.run(command, cwd=folder, check=True)


@pytest.mark.thorough
def test_a_library_flies_and_what_it_links_to_is_declared(make, tmp_path):
    layout = [("path", 2), ("limit", 0)]
    far = tmp_path / "lib"
    far.mkdir()
    shutil.copy(tmp_path / "gain.h", far)
    build(far, GAIN, layout, "libhelp")
    shutil.copy(far / "libhelp.so", tmp_path / "libhelp.so")
    build(tmp_path, PLAIN, layout, "libmine", "-L.", "-lhelp", "-Wl,-rpath,$ORIGIN")
    head = "law: c\nlibrary: libmine.so\nsettings: {path: [0.5, 90 %], limit: 60 deg}\n"
    (tmp_path / "own.yaml").write_text(head)
    with pytest.raises(InputError, match=r"libhelp.so.*files: \[libhelp.so\]"):
        short_plan(100, tmp_path / "own.yaml", "level")
    (tmp_path / "own.yaml").write_text(head + "files: [libhelp.so]\n")
    short = short_plan(100, tmp_path / "own.yaml", "level")
    assert np.array_equal(
        fly(short, disperse(2)).metrics, fly(make(PLAIN), disperse(2)).metrics, equal_nan=True
    )
    (tmp_path / "own.yaml").write_text(
        head.replace("limit", "bank_limit") + "files: [libhelp.so]\n"
    )
    with pytest.raises(InputError, match=r"\blimit\b.*\bbank_limit\b"):
        short_plan(100, tmp_path / "own.yaml", "level")
    build(far, GAIN, layout, "libfar")
    build(tmp_path, PLAIN, layout, "libmine", f"-L{far}", "-lfar", f"-Wl,-rpath,{far}")
    (tmp_path / "own.yaml").write_text(head)
    with pytest.raises(InputError, match=r"libfar\.so.*files: \[libfar\.so\]"):
        short_plan(100, tmp_path / "own.yaml", "level")


def test_the_headers_functions_have_the_kernels_bits(tmp_path):
    text = '#include "abhv_law.h"\n'
    text += "void all(const double *x, double *y, long n) { for (long i = 0; i < n; i++) {\n"
    text += "abhv_sincos(x[i], y + 4 * i, y + 4 * i + 1); y[4 * i + 2] = abhv_wrap(x[i]);\n"
    text += "y[4 * i + 3] = abhv_clamp(x[i], -1.5, 2.5); } }\n"
    build(tmp_path, text, [], "all")
    generator = np.random.default_rng(3)
    x = np.concatenate(
        [
            generator.uniform(-9.0, 9.0, 20_000),
            generator.uniform(-1e6, 1e6, 2000),
            [np.nan, 2e6, 0.0],
        ]
    )
    y = np.empty((len(x), 4))
    ctypes.CDLL(str(tmp_path / "all.so")).all(
        ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(y.ctypes.data), ctypes.c_long(len(x))
    )
    expected = np.array(
        [(*sincos.py_func(v), wrap.py_func(v), clamp.py_func(v, -1.5, 2.5)) for v in x.tolist()]
    )
    assert np.array_equal(y, expected, equal_nan=True)
