"""Effectors with actuators of their own: against a brute-force integration, against actuators of the axes, failing."""

import json

import numpy as np
import pytest
from short_flights import change_vehicle, cut, rows_of, write_law

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flight.fly import fly, fly_until, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import prepare
from abhv_mc.io.input_error import InputError, InputErrors
from abhv_mc.kernel.laws.columns import REFERENCE
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.vehicle import VARIABLES
from abhv_mc.shipped import shipped_configs
from abhv_mc.simulators.end_sentence import describe_end
from abhv_mc.simulators.engine import make_engine
from abhv_mc.simulators.make_plans import make_plans

CONFIGS = shipped_configs()
COUNT = 16
LIMITS = [(-5.0 - i, 6.0 + i) for i in range(COUNT)]  # deg
RATES = [40.0 + 20.0 * i for i in range(COUNT)]  # deg/s
BANDWIDTHS = [20.0 + 4.0 * i for i in range(COUNT)]  # rad/s
DAMPINGS = [0.5 + 0.03 * i for i in range(COUNT)]
ROW = s.VAR + VARIABLES.index("effector_0")
LAW = """
from typing import NamedTuple
from abhv_mc.extend import Command, controller

@controller{how}
def law(time, reference):
    step = 0.0 if time < 0.05 else 0.2 if time < 0.3 else -0.3
    return Command(
        0.01, 0.02, reference.elevator, equivalence_ratio=reference.equivalence_ratio,
        effectors={{{given}}},
    )
"""


def write_vehicle(folder, effectors: str, name: str = "ghame_x"):
    text = (CONFIGS / "vehicle" / f"{name}.yaml").read_text(encoding="utf-8")
    old = text[text.find("\neffectors:") : text.index("\npropulsion:")] if "\neffectors:" in text else ""
    return change_vehicle(folder, (f"{old}\npropulsion:", f"\neffectors:\n{effectors}\n\npropulsion:"), name=name)


def sixteen() -> str:
    lines = []
    for i in range(COUNT):
        low, high = LIMITS[i]
        own = (
            "ideal: true"
            if i == 3
            else f"rate: {RATES[i]} deg/s, bandwidth: {BANDWIDTHS[i]} rad/s, damping: {DAMPINGS[i]}"
        )
        lines.append(
            f"  flap_{i}: {{aileron: {0.1 * i}, rudder: 0.5, elevator: 1.0, limits: [{low} deg, {high} deg], {own}}}"
        )
    return "\n".join(lines)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Plan of a law that commands half of sixteen effectors itself."""
    return make_plan(tmp_path_factory.mktemp("effectors"))


def make_plan(folder, given: str | None = None, how: str = ""):
    given = given or ", ".join(f'"flap_{i}": step' for i in range(0, COUNT, 2))
    law = write_law(folder, LAW.format(given=given, how=how))
    return cut(prepare(write_vehicle(folder, sixteen()), CONFIGS / "mission" / "level.yaml", law, "own"), 60)


def positions(plan, ticks, parameters=None):
    """Deflections [tick, flight, effector] at ticks."""
    parameters = nominal_parameters() if parameters is None else parameters
    kept = None
    rows = []
    for tick in ticks:
        kept = fly_until(plan, parameters, tick, kept)
        rows.append(kept.rows[:, ROW : ROW + COUNT].copy())
    return np.array(rows)


def expected(plan, parameters, ticks):
    """The same by steps of 5 us of each effector's equation."""
    dt, fine = 5e-6, 2000
    mix = np.array([[0.1 * i, 0.5, 1.0] for i in range(COUNT)])
    low, high = np.radians(LIMITS).T
    rate_limit, w, z = np.radians(RATES) * parameters[PARAMETER_INDEX["actuator.rate_limit"]], BANDWIDTHS, DAMPINGS
    w = np.array(w) * parameters[PARAMETER_INDEX["actuator.bandwidth"]]
    elevator = plan.reference[:, REFERENCE.index("elevator")]
    position = np.clip(mix[:, 2] * plan.initial_state[s.ELEVATOR], low, high)
    rate, found = np.zeros(COUNT), {}
    for tick in range(max(ticks)):
        time = 0.01 * tick
        step = 0.0 if time < 0.05 else 0.2 if time < 0.3 else -0.3
        command = mix @ [0.01, 0.02, elevator[tick]]
        command[::2] = step
        command = np.clip(command, low, high)
        for _ in range(fine):
            rate = np.clip(
                rate + dt * (w**2 * (command - position) - 2.0 * np.array(z) * w * rate), -rate_limit, rate_limit
            )
            moved = position + dt * rate
            position = np.clip(moved, low, high)
            rate = np.where(moved == position, rate, 0.0)
        position[3], rate[3] = command[3], 0.0
        found[tick + 1] = position.copy()
    return np.array([found[tick] for tick in ticks])


def test_sixteen_effectors_move_by_their_own_limits_rates_and_lags(flown) -> None:
    parameters = nominal_parameters(1)
    parameters[0, PARAMETER_INDEX["actuator.bandwidth"]] = 1.2
    parameters[0, PARAMETER_INDEX["actuator.rate_limit"]] = 0.8
    ticks = [6, 12, 30, 36, 60]
    found, wanted = positions(flown, ticks, parameters)[:, 0], expected(flown, parameters[0], ticks)
    assert np.abs(found - wanted).max() < 2e-4  # rad; a stop met within a step of the brute force costs most


def test_an_effector_sticks_is_slow_and_loses_effectiveness(flown) -> None:
    cases = ({}, {"stuck_time": 0.1}, {"slow_time": 0.0, "rate_limit": 0.1}, {"loss_time": 0.0, "effectiveness": 0.4})
    parameters = rows_of(*({f"failure.effector_14.{name}": x for name, x in case.items()} for case in cases))
    at = positions(flown, [10, 11, 20, 60], parameters)[:, :, 14]
    assert np.ptp(at[:, 1]) < 1e-12 < np.ptp(at[:, 0])
    assert at[2, 2] - at[0, 2] == pytest.approx(0.1 * np.radians(RATES[14]) * 0.1, rel=1e-3)
    assert at[:, 3] == pytest.approx(0.4 * at[:, 0], rel=1e-12)


def test_a_law_in_plain_python_commands_the_same(tmp_path, flown) -> None:
    plain = make_plan(tmp_path, how="(compiled=False)")
    assert np.array_equal(positions(plain, [20]), positions(flown, [20]))


def test_an_effectors_command_that_is_no_number_ends_the_flight_by_its_name(tmp_path) -> None:
    given = '"flap_2": 0.1, "flap_4": 1e300 * 1e300 - 1e300 * 1e300 if time > 0.1 else step'
    plan = make_plan(tmp_path, given, "(compiled=False)")
    block = fly(plan, nominal_parameters(1))
    assert block.outcome[0] == Outcome.NOT_FINITE
    assert "effector flap_4 at 0.11 s" in describe_end(plan, nominal_parameters(1), Outcome.NOT_FINITE)


@pytest.mark.parametrize(
    ("given", "words"),
    [('"flop": step', "flop"), ('**{"flap_0": step}', "other effectors")],
    ids=["unknown", "no names"],
)
def test_effectors_that_there_are_not_are_refused(tmp_path, given: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_plan(tmp_path, given)


def test_a_campaign_with_failures_of_axes_is_refused_where_effectors_move_themselves(tmp_path) -> None:
    write_vehicle(tmp_path, sixteen())
    shipped = CONFIGS / "mission" / "level.yaml", CONFIGS / "control" / "tlc.yaml"
    files = {"vehicle": "vehicle.yaml", "mission": str(shipped[0]), "controllers": {"tlc": str(shipped[1])}}
    failing = {"failure.aileron.loss_time": {"distribution": "uniform", "low": "1 s", "high": "2 s"}}
    weak = {"control.flap_3_effectiveness": {"distribution": "uniform", "half_width": "20 %"}}
    for name, dispersions in (("failing", failing), ("weak", weak)):
        text = {"name": name, **files, "runs": 4, "seed": 1, "dispersions": dispersions}
        (tmp_path / f"{name}.yaml").write_text(json.dumps(text), encoding="utf-8")
    weaker = read_campaign(tmp_path / "weak.yaml")
    assert weaker.names == ("control.effector_3_effectiveness",)
    with pytest.raises(InputError, match="failure of an effector: flap_0"):
        make_plans(read_campaign(tmp_path / "failing.yaml"), ["tlc"], make_engine())


def test_all_laws_of_a_campaign_fly_one_list_of_actuators_whose_usage_is_counted(tmp_path) -> None:
    write_vehicle(tmp_path, "  left: {aileron: -1, elevator: 1}\n  right: {aileron: 1, elevator: 1}")
    write_law(tmp_path, LAW.format(given='"left": step', how=""))
    tlc, level = str(CONFIGS / "control" / "tlc.yaml"), str(CONFIGS / "mission" / "level.yaml")
    text = {"name": "one", "vehicle": "vehicle.yaml", "mission": level, "runs": 2, "seed": 1, "dispersions": {}}
    text |= {"requirements": [{"metric": "left_max_deg", "below": 30, "probability": 0.5}]}
    channels = ["right_command_deg", "altitude_m", "left_deg"]
    text |= {"keep": {"histories": {"channels": channels}}}
    text |= {"metrics": {"swing_deg": {"of": "left_deg - right_command_deg", "statistic": "peak_to_peak"}}}
    for controllers in ({"tlc": tlc, "own": "law.yaml"}, {"tlc": tlc}):
        (tmp_path / "one.yaml").write_text(json.dumps(text | {"controllers": controllers}), encoding="utf-8")
        if len(controllers) == 1:
            with pytest.raises((InputError, InputErrors), match="channel 'left_deg'"):
                read_campaign(tmp_path / "one.yaml")
            continue
        campaign = read_campaign(tmp_path / "one.yaml")
        assert campaign.kept_channels == ("altitude_m", "left_deg", "right_command_deg")
        plans = make_plans(campaign, controllers, make_engine())
        for plan in plans.values():
            assert [m.name for m in plan.metrics] == [m.name for m in campaign.measured] and "left" in plan.effectors
            block = fly(cut(plan, 60), nominal_parameters(1), 1)
            at = [channel.name for channel in plan.channels].index("left_deg")
            place = [metric.name for metric in plan.metrics].index("left_max_deg")
            assert block.metrics[0, place] == pytest.approx(np.abs(block.history[0, :, at]).max(), rel=1e-6)


STEP_LAW = """
from abhv_mc.extend import Command, controller

@controller(compiled=False)
def law(reference):
    return Command({aileron}, 0.0, reference.elevator, equivalence_ratio=reference.equivalence_ratio{given})
"""
ELEVONS = [(side, limit) for side in (-1, 1) for limit in (0, 1)]


@pytest.mark.parametrize(
    ("effectors", "limits"),
    [
        ([(-1, 0), (1, 0)], (18, 18)),
        ([(-1, 0), (1, 0)], (3, 3)),
        ([(0, 0), (0, 1)], (20, 6)),
        (ELEVONS, (20, 6)),
        (ELEVONS, (20, 2)),
    ],
    ids=["elevons 18", "elevons 3", "ailerons 20 and 6", "elevons 20 and 6", "elevons 20 and 2"],
)
def test_less_effectiveness_is_that_share_of_the_roll_rate(tmp_path, effectors, limits) -> None:
    """At every limit, by axes and by effectors: of the axes, and of all effectors one by one."""
    lines, terms, given = [], [], []
    for i, (side, limit) in enumerate(effectors):
        mix = f"aileron: {side}, elevator: 1" if side else "aileron: 1"
        own = f"limits: [-{limits[limit]} deg, {limits[limit]} deg], rate: 400 deg/s, bandwidth: 50 rad/s, damping: 0.7"
        lines.append(f"  flap_{i}: {{{mix}, {own}}}")
        terms.append(f"{{table: roll_aileron, times: flap_{i}, scale: {(side or 1) / len(effectors)}}}")
        given.append(f'"flap_{i}": {{0}} * {side or 1} + reference.elevator * {abs(side)}')
    joined = "\n    - ".join(terms)
    effector_lines = "\neffectors:\n" + "\n".join(lines) + "\n\npropulsion:"
    vehicle = change_vehicle(
        tmp_path,
        ("\npropulsion:", effector_lines),
        ("{table: roll_aileron, times: aileron}", joined),
        *(
            (f"{{table: {name}_aileron, times: aileron", f"{{table: {name}_aileron, scale: 0.0, times: aileron")
            for name in ("side", "yaw")
        ),
    )
    ks = (1.0, 0.8, 0.5, 0.2)
    cases = [{"control.aileron_effectiveness": k} for k in ks]
    cases += [{f"control.effector_{i}_effectiveness": k for i in range(len(effectors))} for k in ks[1:]]
    for by in ("axes", "effectors"):
        rates = []
        for aileron in ("0.0", "0.2967"):
            commands = ", ".join(given).replace("{0}", aileron)
            text = STEP_LAW.format(
                aileron=aileron if by == "axes" else "0.0", given="" if by == "axes" else f", effectors={{{commands}}}"
            )
            law = write_law(tmp_path, text)
            plan = cut(prepare(vehicle, CONFIGS / "mission" / "level.yaml", law, "own"), 5)
            rates.append(fly(plan, rows_of(*cases), 1, keep_states=True).states[:, 5, s.ROLL_RATE])
        felt = rates[1] - rates[0]
        np.testing.assert_allclose(felt / felt[0], [*ks, *ks[1:]], rtol=0.01)
