"""Tests of control laws as FMUs (FMI 2.0 and 3.0): equality with built-in laws, resets, leaks."""

import shutil
import struct

import numpy as np
import pytest
from short_flights import assert_same, change_vehicle, disperse, short_plan

pytest.importorskip("fmpy")
if shutil.which("cc") is None:
    pytest.skip("no C compiler", allow_module_level=True)

from fmu.make_fmu import ELEVONS, SEEN, make_fmu, measure_leak, write_controller

from abhv_mc.custom_code.child import in_child
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc_fmu.loop import NAMES, decode, encode, pack
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.stability.linearize import linearize
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.stability.probe import law_memory_rows


@pytest.fixture
def make(repository, tmp_path):
    def make_plan(version, seconds=1.0, units=None, change=None, memory=""):
        make_fmu(tmp_path / "lqr.fmu", version, repository, units, memory)
        write_controller(tmp_path / "mine.yaml", "lqr.fmu", repository)
        if change:
            text = (tmp_path / "mine.yaml").read_text()
            assert change[0] in text
            (tmp_path / "mine.yaml").write_text(text.replace(*change))
        return short_plan(round(seconds * 100), tmp_path / "mine.yaml")

    return make_plan


@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.thorough), 3])
def test_lqr_as_an_fmu_is_the_built_in_lqr_to_the_bit(make, version):
    parameters = disperse(300)  # more flights than lanes, so that instances are reset
    block = fly(make(version, 6.0), parameters, 50)
    assert_same(block, fly(short_plan(600, "lqr"), parameters, 50))
    assert (block.outcome != Outcome.OK).any()


@pytest.mark.thorough
def test_units_of_the_model_description_are_converted(make):
    """70 deg in a variable in degrees is the number 70, for the FMU 70 rad, which is no limit."""
    parameters = disperse(3)
    wired, unlimited = (
        make(2, units={"bank_limit": "deg"}),
        make(2, change=("bank_limit: 70 deg", "bank_limit: 70 rad")),
    )
    assert np.array_equal(
        fly(wired, parameters).metrics, fly(unlimited, parameters).metrics, equal_nan=True
    )
    radians, degrees = make(2), make(3, units={"measured.bank": "deg"})
    assert not np.array_equal(
        fly(radians, parameters).metrics, fly(degrees, parameters).metrics, equal_nan=True
    )


@pytest.mark.parametrize(
    ("change", "units", "name"),
    [
        (("measured.bank: measured.bank", "measured.bank: measured.banc"), None, "measured.banc"),
        (("  rudder: command.rudder\n", ""), None, "rudder"),
        (
            ("gains.earth_radius: gains.earth_radius", "gains.earth_radius: gains.k"),
            None,
            "gains.k",
        ),
        (None, {"measured.altitude": "deg"}, "measured.altitude"),
        (
            ("bank_limit: 70 deg", "bank_limit: 70 m"),
            {"bank_limit": "deg"},
            "bank_limit: 70 m",
        ),
    ],
)
def test_a_wrong_wiring_is_refused_by_name(make, change, units, name):
    with pytest.raises(InputError) as refused:
        make(2, units=units, change=change)
    assert name in str(refused.value)


def test_a_wrong_wiring_is_refused_at_its_line(make, tmp_path):
    with pytest.raises(InputErrors) as refused:
        make(3, change=("  measured.bank: measured.bank\n", "  bank: measured.bank\n  tilt: 3\n"))
    lines = (tmp_path / "mine.yaml").read_text().splitlines()
    locations = [(error.file, lines[error.line - 1].strip()) for error in refused.value.errors]
    path = str(tmp_path / "mine.yaml")
    assert locations == [(path, "bank: measured.bank"), (path, "tilt: 3")]
    assert "'bank'" in refused.value.errors[0].found


@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.thorough), 3])
def test_other_kinds_of_numbers_and_constants_are_wired(make, tmp_path, version):
    """Command the elevator in single precision, times a constant, and the engine by a Boolean."""
    parameters = disperse(3)
    plain = fly(make(version), parameters).metrics

    def flown(gain, stage="-3", runs=False):
        constants = f"inputs:\n  enable: true\n  stage: {stage}\n  gain: {gain}\n"
        make(version, change=("inputs:\n", constants))
        path = tmp_path / "mine.yaml"
        text = path.read_text().replace("elevator: command.elevator", "elevator: single")
        if runs:
            text = text.replace("ratio: command.equivalence_ratio", "ratio: runs")
        path.write_text(text)
        return fly(short_plan(100, path), parameters)

    single = flown("1.0")
    assert single.metrics == pytest.approx(plain, rel=1e-3, abs=1e-4, nan_ok=True)
    assert np.array_equal(single.metrics, plain, equal_nan=True) == (version == 2)
    assert np.nanmax(np.abs(flown("50 %").metrics - plain)) > 1e-3
    assert (flown("1.0", runs=True).metrics != plain).any()
    with pytest.raises(InputError, match="control law"):
        flown("1.0", stage="2")


@pytest.mark.parametrize(
    ("kind", "form", "values"),
    [
        ("Boolean1", "?", [0.0, 1.0]),
        ("Boolean4", "i", [0.0, 1.0]),
        ("Int8", "b", [-128.0, 127.0, -3.0]),
        ("UInt8", "B", [0.0, 255.0]),
        ("Int16", "h", [-32768.0, 32767.0]),
        ("UInt16", "H", [65535.0]),
        ("Int32", "i", [-(2.0**31), 2.0**31 - 1.0]),
        ("UInt32", "I", [2.0**32 - 1.0]),
        ("Int64", "q", [-(2.0**53), 2.0**53]),
        ("UInt64", "Q", [2.0**53]),
        ("Float32", "f", [0.5, -1.25, float(np.float32(0.1))]),
    ],
)
def test_numbers_of_each_type_are_packed_in_the_low_bytes(kind, form, values):
    for value in values:
        bits = pack(kind, value)
        low = struct.pack("<q", bits)[: struct.calcsize(form)]
        assert struct.unpack(f"<{form}", low)[0] == value
        names = {**NAMES, "value": value, "bits": np.int64(bits)}
        assert eval(encode(kind, "value"), names) == bits  # noqa: S307  generated by this package
        assert eval(decode(kind, "bits"), names) == value  # noqa: S307


def test_integers_are_rounded_and_limited_to_their_range():
    assert [pack("Int8", value) for value in (1e9, -1e9, 2.5, -0.6)] == [127, -128, 3, -1]
    assert pack("UInt16", -1e9) == 0


def test_an_error_of_a_step_ends_the_flight(make):
    parameters = nominal_parameters(3)
    parameters[1, PARAMETER_INDEX["initial.bank"]] = 1.6
    outcomes = [Outcome(code) for code in fly(make(3), parameters).outcome]
    assert outcomes[1] == Outcome.LAW_FAILED and Outcome.LAW_FAILED not in (
        outcomes[0],
        outcomes[2],
    )


@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.thorough), 3])
def test_slopes_equal_those_of_the_built_in_lqr_and_include_declared_states(make, version):
    """The law reduces the throttle by the integral of the speed error after the step."""
    parameters, time = disperse(2)[1:], 0.5
    built_in = short_plan(100, "lqr")
    theirs = linearize(built_in, flown_points(built_in, parameters, time).points)
    plain, remembering = make(version), make(version, memory="named")
    ours = linearize(plain, flown_points(plain, parameters, time).points)
    assert ours.law_A.size == 0
    np.testing.assert_allclose(
        ours.law_D[..., :10], theirs.law_D, rtol=0, atol=1e-6 * np.abs(theirs.law_D).max()
    )
    assert list(law_memory_rows(remembering)) == ["speed_integral"]
    slopes = linearize(remembering, flown_points(remembering, parameters, time).points)
    np.testing.assert_allclose(slopes.law_A, 1.0, rtol=1e-9)
    np.testing.assert_allclose(slopes.law_B[0, 0, :2], [0.0, 0.01], atol=1e-9)
    np.testing.assert_allclose(slopes.law_C[0, :, 0], [0.0, 0.0, 0.0, -0.001], atol=1e-9)
    np.testing.assert_allclose(slopes.law_D[0, 3, 1] - ours.law_D[0, 3, 1], -1e-5, atol=1e-9)


def test_slopes_of_an_fmu_with_undeclared_states_are_rejected(make):
    with pytest.raises(InputError, match=r"lqr\.fmu.*Derivatives"):
        flown_points(make(2, 3.0, memory="hidden"), nominal_parameters(), 0.5)


def test_an_fmu_commands_effectors_and_reads_the_nominal_vehicle_and_its_last_command(
    make, repository, tmp_path
):
    """The LQR in C with elevons is equal, and is rejected if its file lacks an entry."""
    signs = dict(zip(ELEVONS, (1, -1), strict=True))
    elevons = "".join(
        f"\n  {name}: {{aileron: {sign}, elevator: 1}}" for name, sign in signs.items()
    )
    rolls = (
        "{table: roll_aileron, times: right, scale: 0.5}\n    - {table: roll_aileron, "
        "times: left, scale: -0.5}"
    )
    vehicle = change_vehicle(
        tmp_path,
        ("\npropulsion:", f"\neffectors:{elevons}\n  fin: {{rudder: 1}}\n\npropulsion:"),
        ("{table: roll_aileron, times: aileron}", rolls),
    )
    make(3)
    text = (tmp_path / "mine.yaml").read_text()
    text = text.replace(
        "outputs:\n", "".join(f"  {name}: {name}\n" for name in SEEN) + "outputs:\n"
    )
    text = text.replace(
        "params:\n", "".join(f"  {name}: {name}\n" for name in ELEVONS) + "params:\n"
    )
    (tmp_path / "mine.yaml").write_text(text)
    shipped = repository / "configs" / "control" / "lqr_c"
    commands = (
        "command->effectors[0] = command->elevator + 0.9 * command->aileron + 1e-7 * "
        "measured->onboard.moment.pitch;"
    )
    commands += (
        "command->effectors[1] = command->elevator - command->aileron + 0.1 * "
        "measured->onboard.last.rudder;"
    )
    head, _, tail = (shipped / "lqr.c").read_text().rpartition("return 0;")
    (tmp_path / "lqr.c").write_text(f"{head}{commands} return 0;{tail}")
    text = (shipped / "lqr_c.yaml").read_text()
    text += f"effectors: [{', '.join(ELEVONS)}]\nonboard: true\n"
    (tmp_path / "law.yaml").write_text(text)
    plans = [
        short_plan(100, tmp_path / f"{name}.yaml", vehicle=vehicle) for name in ("mine", "law")
    ]
    assert_same(*(fly(plan, disperse(4), 10) for plan in plans))
    slopes, expected = (
        linearize(plan, flown_points(plan, disperse(2)[1:], 0.5).points) for plan in plans
    )
    assert slopes.inputs == expected.inputs and set(slopes.inputs) >= {"right", "left", "fin"}
    scale = np.abs(expected.law_D).max()
    np.testing.assert_allclose(
        slopes.law_D[..., :10], expected.law_D[..., :10], rtol=0, atol=1e-6 * scale
    )
    for change, problem in (
        (("onboard: true", ""), r"lqr.c:\d+.*onboard"),
        (("left", "lift"), "lift"),
    ):
        (tmp_path / "law.yaml").write_text(text.replace(*change))
        with pytest.raises((InputError, InputErrors), match=problem):
            short_plan(100, tmp_path / "law.yaml", vehicle=vehicle)


@pytest.mark.thorough
@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.thorough), 3])
def test_a_thousand_flights_leak_neither_memory_nor_handles(make, version):
    memory, handles = in_child(measure_leak, make(version, 0.05), 64)  # 2048 flights
    assert handles == 0
    assert memory < 300_000  # instances of 0.6 kB that are not freed would take 600 kB
