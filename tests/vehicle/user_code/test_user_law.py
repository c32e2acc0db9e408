"""Custom control laws match built-in ones, in any lanes, compiled or in plain Python."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from short_flights import assert_same, disperse, short_plan

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.opening import read_plan, write_plan
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.control.design.design_model import wrench_at
from abhv_mc_vehicle.control.design.lqr_design import make_nominal
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.kernel.flight.fly_lanes import COMPACTION
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle_simulator.stored_plans import rebuild_plan

HEAD = """\
from typing import NamedTuple
from abhv_mc.extend import Command, atan2, clamp, controller, exp, log, sincos, sqrt, table, wrap
"""
# A cascade of gains by hand that holds level flight for a while, with a memory.
CASCADE = (
    HEAD
    + """
class Settings(NamedTuple):
    path: float = 0.9
    bank_limit: float = 1.2

class Memory(NamedTuple):
    speed: float = 0.0
    ticks: float = 0.0

@controller(units={{"bank_limit": "rad"}}{compiled})
def law(measured, reference, memory, settings, time, dt):
    alpha = reference.angle_of_attack - settings.path * (measured.flight_path_angle - \
reference.flight_path_angle)
    speed = measured.speed - reference.speed
    eta = reference.equivalence_ratio - 0.02 * speed - 0.001 * memory.speed
    elevator = reference.elevator + 2.0 * (measured.angle_of_attack - alpha) + 1.5 * \
measured.pitch_rate
    bank, beta, p, r = wrap(measured.bank - reference.bank), measured.sideslip, \
measured.roll_rate, measured.yaw_rate
    aileron = -0.26 * bank - 1.2 * beta - 0.08 * p + 0.06 * r
    rudder = -0.04 * bank - 0.2 * beta - 0.01 * p + 0.04 * r
    after = Memory(memory.speed + dt * speed, memory.ticks + 1.0)
    return Command(aileron, rudder, elevator, eta, angle_of_attack=alpha), after
"""
)


@pytest.fixture
def make(tmp_path):
    """Return a plan of a law's text and the text of its controller file."""

    def make_plan(text, settings="{}", seconds=3.0):
        (tmp_path / "law.py").write_text(text)
        (tmp_path / "law.yaml").write_text(
            f"law: python\nfile: law.py\nrate: 100 Hz\nsettings: {settings}\n"
        )
        return short_plan(round(seconds * 100), tmp_path / "law.yaml", "level")

    return make_plan


MATHS = (
    "{{}}\n"  # as a recipe begins
    + HEAD
    + """
lift = table([-1.0, 0.0, 0.5, 2.0], [3.0, -1.0, 0.25, 7.0])
surface = table([0.0, 1.0, 2.0], [-1.0, 1.0], [[1.0, 2.0], [0.3, -4.0], [5.0, 0.1]])

def helper(x, y=2.0):
    return clamp(x * y, -1.0, 1.0)

@controller(units={{}}{compiled})
def law(measured, /, reference, time):
    s, c = sincos(measured.heading)
    x = atan2(measured.sideslip, measured.angle_of_attack) + exp(-abs(measured.bank)) * \
log(measured.speed)
    y = wrap(measured.bank * 3.0) + lift(measured.bank) - surface(measured.sideslip, c)
    a = helper(x) + helper(y, 0.5) + sqrt(abs(s)) if time >= 0.0 else 0.0
    return Command(0.01 * a, 0.01 * x, 0.01 * y, 0.5 + 0.1 * s, a, x, y)
"""
)


@pytest.mark.parametrize("law", [CASCADE, MATHS], ids=["a memory", "all functions"])
def test_plain_python_flies_the_same_bits_and_follows_its_memory_through_compaction(make, law):
    seconds = 1.1 * COMPACTION / 100
    compiled = make(law.format(compiled=""), seconds=seconds)
    plain = make(law.format(compiled=", compiled=False"), seconds=seconds)
    parameters = disperse(LANES + 3)
    parameters[6:26, PARAMETER_INDEX["initial.angle_of_attack"]] = 0.5  # most end at the start
    assert_same(fly(compiled, parameters, 10), fly(plain, parameters, 10))


RAISES = (
    "@controller(compiled=False)\ndef law(time):\n    if time > 0.2:\n        raise "
    "KeyError('lost')\n{}"
)


def test_an_exception_in_plain_python_ends_the_flight_and_is_told_once(make, capsys):
    plan = make(HEAD + RAISES.format("    return Command(0.0, 0.0, 0.0, 0.5)\n"))
    block = fly(plan, nominal_parameters(3))
    assert [Outcome(code) for code in block.outcome] == [Outcome.LAW_FAILED] * 3
    errors = capsys.readouterr().err
    assert errors.count("KeyError: 'lost'") == 1
    assert 'law.py", line 6' in errors


def test_memory_of_any_kind_in_plain_python(make):
    text = HEAD + "class Memory:\n    def __init__(self):\n        self.seen = []\n\n"
    text += (
        "@controller(compiled=False)\ndef law(measured, memory, reference):\n    "
        "memory.seen.append(measured.bank)\n"
    )
    text += "    return Command(-memory.seen[0], 0.0, reference.elevator, 1.0), memory\n"
    plan = make(text, seconds=0.1)
    parameters = nominal_parameters(3)
    parameters[:, PARAMETER_INDEX["initial.bank"]] = [0.0, 0.01, 0.02]
    block = fly(plan, parameters, 1)
    command = block.history[:, -1, CHANNEL_INDEX["aileron_command_deg"]]
    assert np.allclose(command, -np.rad2deg([0.0, 0.01, 0.02]), atol=1e-3)


def test_commands_are_clamped_and_missing_ones_are_the_references(make):
    text = HEAD + "@controller\ndef law():\n    return Command(9.0, -9.0, 9.0, -5.0)\n"
    plan = make(text, seconds=0.05)
    history = fly(plan, nominal_parameters(), 1).history[0, 1]
    limit = np.rad2deg(plan.vehicle.constants.surface_limit)
    names = ("aileron", "rudder", "elevator")
    assert np.allclose(
        [history[CHANNEL_INDEX[f"{n}_command_deg"]] for n in names], [limit, -limit, limit]
    )
    assert history[CHANNEL_INDEX["equivalence_ratio_command"]] == np.float32(
        plan.vehicle.constants.equivalence_ratio_min
    )
    reference = np.rad2deg(plan.reference[1, 8])
    assert np.isclose(history[CHANNEL_INDEX["angle_of_attack_command_deg"]], reference)


def test_a_stored_plan_holds_no_source_and_does_not_fly_without(make, tmp_path, repository):
    plan = make(CASCADE.format(compiled=""))
    write_plan(tmp_path / "plan.npz", plan)
    assert b"NamedTuple" not in (tmp_path / "plan.npz").read_bytes()
    vehicle = load_vehicle(repository / "configs/vehicle/ghame_x.yaml")
    stored = read_plan(tmp_path / "plan.npz", lambda arrays: rebuild_plan(arrays, vehicle))
    assert stored.source is None
    assert stored.source_hash == plan.source.hash
    with pytest.raises(ValueError, match=r"\bsource\b"):
        fly(stored, nominal_parameters())
    travelled = pickle.loads(pickle.dumps(plan))  # noqa: S301  as to a worker process
    assert_same(fly(plan, nominal_parameters(2)), fly(travelled, nominal_parameters(2)))


def test_onboard_is_the_nominal_vehicle(make, capsys):
    """Moments, forces and slopes agree with differences of the numpy design model."""
    names = ["dynamic_pressure", "moment_by_elevator.pitch", "moment_by_aileron.roll",
        "moment_by_rudder.yaw",
             "thrust_by_equivalence_ratio", "lift_by_angle_of_attack", "inertia.yy"]  # fmt: skip
    text = HEAD + "@controller(compiled=False)\ndef law(onboard, reference):\n"
    text += f"    print([{', '.join(f'onboard.{name}' for name in names)}])\n"
    plan = make(
        text + "    return Command(0.0, 0.01, reference.elevator, reference.equivalence_ratio)\n",
        seconds=0.01,
    )
    fly(plan, nominal_parameters())
    onboard = dict(zip(names, json.loads(capsys.readouterr().out.splitlines()[0]), strict=True))
    state = plan.initial_state
    alpha, eta, elevator = np.arctan2(state[5], state[3]), state[20], state[16]
    mission = read_mission(Path(__file__).parents[3] / "configs" / "mission" / "level.yaml")
    nominal = make_nominal(mission, plan.reference[0])
    speed, mass = float(np.hypot(state[3], state[5])), nominal.mass

    def wrench(alpha=alpha, aileron=0.0, rudder=0.0, elevator=elevator, eta=eta):
        alpha, beta, eta, *deflections = (
            np.array([x]) for x in (alpha, 0.0, eta, aileron, rudder, elevator)
        )
        return wrench_at(
            plan.vehicle,
            nominal.environment,
            mass,
            speed,
            alpha,
            beta,
            3 * [beta],
            deflections,
            eta,
        )

    h, wrench_here = 1e-6, wrench()

    def slope(quantity, **moved):
        return (quantity(wrench(**moved)) - quantity(wrench_here))[..., 0] / h

    lift = slope(lambda point: point.force, alpha=alpha + h) @ [np.sin(alpha), 0.0, -np.cos(alpha)]
    expected = {
        "dynamic_pressure": (0.5 * nominal.environment.density * speed**2, 1e-5),
        "inertia.yy": (wrench_here.inertia[1, 1], 1e-5),
        "moment_by_elevator.pitch": (
            slope(lambda point: point.moment[1], elevator=elevator + h),
            1e-4,
        ),
        "moment_by_aileron.roll": (slope(lambda point: point.moment[0], aileron=h), 1e-4),
        "moment_by_rudder.yaw": (slope(lambda point: point.moment[2], rudder=h), 1e-4),
        "thrust_by_equivalence_ratio": (
            np.hypot(*slope(lambda point: point.force[[0, 2]], eta=eta + h)),
            0.05,
        ),
        "lift_by_angle_of_attack": (lift, 0.1),
    }
    for name, (value, tolerance) in expected.items():
        assert np.isclose(onboard[name], value, rtol=tolerance), name


def test_inversion_with_the_vehicle_on_board_flies_the_s():
    block = fly(make_flight_plan("s_manoeuvre", "ghame_x", "inversion"), nominal_parameters())
    assert block.outcome[0] == Outcome.OK
    assert block.metrics[0, METRIC_INDEX["altitude_error_max_m"]] < 20.0


def test_design_gives_gains_and_the_linear_plant(make):
    text = HEAD + (
        "import numpy as np\n"
        "class Settings(NamedTuple):\n"
        "    scale: float = 1.0\n"
        "\n"
        "class Gains(NamedTuple):\n"
        "    pitch: np.ndarray\n"
        "    constant: float\n"
        "\n"
        "def design(model, settings):\n"
        "    plant = model.linearize(10.0)\n"
        "    A, B = plant.take(('angle_of_attack', 'pitch_rate'), ('elevator',))\n"
        "    assert A.shape == (2, 2) and B.shape == (2, 1) and plant.A.shape == (10, 10)\n"
        "    assert abs(A[0, 1] - 1.0) < 0.01 and B[1, 0] < 0.0\n"
        "    assert 0.0 < model.trim(10.0).angle_of_attack < 0.2\n"
        "    return Gains(settings.scale * model.reference.speed / model.reference.speed[0], "
        "3.0)\n"
        "\n"
        "@controller\n"
        "def law(gains, reference):\n"
        "    return Command(0.01 * gains.pitch, 0.001 * gains.constant, reference.elevator, "
        "1.0)\n"
    )
    plan = make(text, "{scale: 50 %}", seconds=0.05)
    assert plan.gain_names.tolist() == ["pitch", "constant"]
    history = fly(plan, nominal_parameters(), 1).history[0, 1]
    assert np.isclose(history[CHANNEL_INDEX["aileron_command_deg"]], np.rad2deg(0.005), rtol=1e-4)


LINE = "    return Command(0.0, 0.0, 0.0, 1.0)\n"
MUTE = "class Mute(Exception):\n    def __str__(self):\n        raise RuntimeError\nraise Mute\n"
WRONG = [
    ("def law(measured):\n    x = [measured.bank]\n" + LINE, 5, "lists", "lists"),
    (
        "def law(measured):\n    x = measured.alttitude\n" + LINE,
        5,
        "measured.alttitude",
        "'altitude'",
    ),
    ("def law(measured):\n    global n\n    n = 1\n" + LINE, 5, "'n'", "Memory"),
    (
        "def law(measured):\n    if measured.bank > 0.0:\n    " + LINE,
        5,
        "'return'",
        "return Command",
    ),
    ("def law(measured):\n    return 1.0\n", 5, "'return 1.0'", "return Command"),
    ("def law(measured):\n" + LINE + MUTE, 9, "Mute", "errors"),
    ("def law(measurd):\n" + LINE, 4, "'measurd'", "'measured'"),
    ("def law(memory):\n" + LINE, 4, "'memory'", "class Memory"),
    ("def law(measured):\n    x = measured.bank @ 1.0\n" + LINE, 5, "compile", "floats"),
]


@pytest.mark.parametrize(("text", "line", "problem", "expected"), WRONG)
def test_what_cannot_be_compiled_is_said_in_the_users_terms(
    make, tmp_path, text, line, problem, expected
):
    with pytest.raises(InputError) as caught:
        make(HEAD + "@controller\n" + text)
    error = caught.value
    assert problem in error.found, str(error)
    assert expected in error.expected or expected in error.found, str(error)
    assert error.file == str(tmp_path / "law.py")
    assert error.line == line or (error.line is None and "something" in problem), str(error)


PLAIN = "@controller(compiled=False)\n"
NAN = "(measured.bank - measured.bank) / (measured.speed - measured.speed)"
MEMORY = "class Memory(NamedTuple):\n    last: float = 0.0\n\n"
FIRST_TICKS = {
    "not finite": (
        f"@controller\ndef law(measured):\n    return Command(0.0, 0.0, {NAN}, 1.0)\n",
        (4, "the elevator command is not finite at 0 s"),
    ),
    "not finite in Python": (
        f"{PLAIN}def law(measured):\n    return Command(0.0, float('nan'), 0.0, 1.0)\n",
        (4, "the rudder command is not finite at 0 s"),
    ),
    "angle": (
        "@controller\ndef law(time):\n    angle = log(time - 1.0)\n"
        "    return Command(0.0, 0.0, 0.0, 1.0, bank=angle)\n",
        (4, "the bank angle commanded by the guidance is not finite at 0 s"),
    ),
    "memory": (
        f"{MEMORY}@controller\ndef law(measured, memory):\n"
        f"    return Command(memory.last, 0.0, 0.0, 1.0), Memory({NAN})\n",
        (7, "the aileron command is not finite at 0.01 s"),
    ),
    "exception": (
        f"{PLAIN}def law(measured):\n    x = 1.0 / (measured.bank - measured.bank)\n" + LINE,
        (5, "(ZeroDivisionError: float division by zero)"),
    ),
    "name": (
        f"{PLAIN}def law(measured):\n    x = slope * measured.bank\n" + LINE,
        (5, "(NameError: name 'slope' is not defined)"),
    ),
    "few commands": (
        f"{PLAIN}def law():\n    return Command(0.0, 0.0)\n",
        (5, "required positional argument: 'elevator')"),
    ),
    "few compiled commands": (
        "@controller\ndef law():\n    return Command(0.0, 0.0)\n",
        (5, " compile"),
    ),
    "unknown command": (
        "@controller\ndef law():\n    return Command(0.0, 0.0, 0.0, flaps=1.0)\n",
        (5, " compile"),
    ),
    "unknown name": (
        "@controller\ndef law(measured):\n    x = slope * measured.bank\n" + LINE,
        (5, "'slope'"),
    ),
    "many memories": (
        f"{MEMORY}@controller\ndef law(memory):\n"
        "    return Command(0.0, 0.0, 0.0), Memory(0.0, 1.0)\n",
        (8, " compile"),
    ),
    "no memory": (
        f"{MEMORY}{PLAIN}def law(memory):\n    return Command(0.0, 0.0, 0.0)\n",
        (7, "Command, not Command(...), memory"),
    ),
    "start of the memory": (
        "class Memory:\n    def __init__(self):\n        raise KeyError('lost')\n\n"
        f"{PLAIN}def law(memory):\n    return Command(0.0, 0.0, 0.0), memory\n",
        (5, "(KeyError: 'lost')"),
    ),
}


@pytest.mark.parametrize("case", FIRST_TICKS)
def test_a_law_that_fails_at_its_first_ticks_is_rejected_with_its_line(make, tmp_path, case):
    text, (line, problem) = FIRST_TICKS[case]
    with pytest.raises(InputError) as caught:
        make(HEAD + text)
    assert problem in caught.value.found, str(caught.value)
    assert (caught.value.file, caught.value.line) == (str(tmp_path / "law.py"), line)


CAMPAIGN = """\
name: own
question: Does the law hold the altitude?
vehicle: {configs}/vehicle/abhv.yaml
mission: {configs}/mission/level.yaml
controllers: {{law: law.yaml}}
runs: 2
seed: 1
sampling: random
dispersions:
  aero.drag: {{distribution: uniform, low: 0.9, high: 1.1}}
requirements: []
"""


def test_commands_reject_a_law_that_is_not_finite_before_anything_flies(tmp_path, abhv_mc):
    law, campaign = tmp_path / "law.yaml", tmp_path / "campaign.yaml"
    law.write_text("law: python\nfile: law.py\n")
    (tmp_path / "law.py").write_text(HEAD + FIRST_TICKS["not finite"][0])
    campaign.write_text(CAMPAIGN.format(configs=shipped_configs()))
    for command in (
        ("validate", law),
        ("validate", campaign),
        ("run", campaign, "-o", tmp_path / "results"),
        ("fly", "level", "--controllers", law),
    ):
        code, output, errors = abhv_mc(*command)
        assert (code, output) == (2, ""), errors
        assert errors.startswith(f"{tmp_path / 'law.py'}:4: the elevator command is not finite")
        assert errors.count("not finite") == 1
    assert not (tmp_path / "results").exists()


def test_a_number_that_is_lost_later_ends_the_flight(make):
    text = HEAD + "@controller\ndef law(time):\n    return Command(0.0, 0.0, log(0.025 - time))\n"
    block = fly(make(text), nominal_parameters())
    assert (block.outcome[0], block.end_time[0]) == (Outcome.NOT_FINITE, 0.03)


@pytest.mark.parametrize(
    ("settings", "place", "named"),
    [
        ("{pth: 1.0}", "4:12", ("'pth'", "'path'", "bank_limit")),
        ("{bank_limit: 60 m}", "4:24", ("'60 m'", "angle")),
        ("{path: fast}", "4:18", ("'fast'",)),
    ],
)
def test_wrong_settings_are_said_with_file_line_and_column(make, tmp_path, settings, place, named):
    with pytest.raises(InputError) as caught:
        make(CASCADE.format(compiled=""), settings)
    assert str(caught.value).startswith(f"{tmp_path / 'law.yaml'}:{place}: ")
    assert all(name in str(caught.value) for name in named)


COUNTS = """
from abhv_mc.extend import Command, controller

class Memory:
    made = 0

    def __init__(self):
        type(self).made += 1
        self.calls = 0

@controller(compiled=False)
def law(reference, memory):
    memory.calls += 1
    with open("{file}", "a") as file:
        file.write(f"{{Memory.made}} {{memory.calls}}\\n")
    return Command(0.0, 0.0, reference.elevator, reference.equivalence_ratio), memory
"""


def test_a_plain_law_is_called_once_for_each_flight_and_tick(make, tmp_path):
    plan = make(COUNTS.format(file=tmp_path / "calls.txt"), seconds=0.1)
    calls = tmp_path / "calls.txt"
    calls.write_text("")  # without the calls that check the law
    fly(plan, nominal_parameters(3))  # three equal flights
    assert len(calls.read_text().split("\n")) - 1 == 3 * 11
    assert calls.read_text().split()[-1] == "11"
