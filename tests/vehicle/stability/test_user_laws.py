"""Laws of the user's own are linearized as the program's own laws are."""

from pathlib import Path

import numpy as np
import pytest
from short_flights import write_law
from vehicle.stability.systems import assert_predicted, decibels, parameters, plans_of

import abhv_mc
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.stability.analysis import NO_SLOPES, analyse, margins_of_flights
from abhv_mc_vehicle.stability.linearize import linearize
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.stability.probe import law_memory_rows
from abhv_mc_vehicle.stability.steady import trim_points

CONFIGS = Path(__file__).parents[3] / "configs" / "control"

# Level flight with an integral of the speed error and a filtered pitch rate: a memory that moves
# the loop.
FILTERED = """\
from typing import NamedTuple
from abhv_mc.extend import Command, controller, sqrt, wrap

class Memory{base}:
    speed: float = 0.0
    pitch_rate: float = 0.0

@controller{compiled}
def law(measured, reference, memory, time, dt):
    speed = measured.speed - reference.speed
    pitch_rate = memory.pitch_rate + dt / 0.02 * (measured.pitch_rate - memory.pitch_rate)
    eta = reference.equivalence_ratio - 0.02 * speed - 0.001 * memory.speed
    path = measured.flight_path_angle - reference.flight_path_angle
    alpha = reference.angle_of_attack - 0.9 * path - {altitude} * \
(measured.altitude - reference.altitude)
    elevator = reference.elevator + 2.0 * (measured.angle_of_attack - alpha) + {pitch} * pitch_rate
    bank, beta, p, r = wrap(measured.bank - reference.bank), measured.sideslip, \
measured.roll_rate, measured.yaw_rate
    aileron = -0.26 * bank - 1.2 * beta - 0.08 * p + 0.06 * r
    rudder = -0.04 * bank - 0.2 * beta - 0.01 * p + 0.04 * r
    return Command(aileron, rudder, elevator, eta, angle_of_attack=alpha), \
Memory(memory.speed + dt * speed, pitch_rate)
"""


def write_filtered(folder, compiled="", base="(NamedTuple)", pitch="1.5", altitude="1e-4"):
    text = FILTERED.format(compiled=compiled, base=base, pitch=pitch, altitude=altitude)
    return write_law(folder, text)


def stability(plan, points, dispersions):
    assert points.faults == [""] * len(dispersions)
    return analyse(linearize(plan, points.points), 1000)


@pytest.mark.parametrize(
    "law", [pytest.param("inversion", marks=pytest.mark.thorough), "filtered", "felt"]
)
def test_a_small_disturbance_of_an_own_laws_flight_follows_its_linear_model(law, tmp_path):
    altitude = "0.01 * (measured.acceleration_z + 9.8) - 1e-4" if law == "felt" else "1e-4"
    own = write_filtered(tmp_path, altitude=altitude)
    plan, _ = plans_of(CONFIGS / "inversion.yaml" if law == "inversion" else own)
    # The fuel's mass is no state of the model.
    assert_predicted(plan, parameters(propulsion__specific_impulse=1e9), 100, 100, every=4)


def test_the_memory_at_a_trim_rests_there(tmp_path):
    _, steady = plans_of(write_filtered(tmp_path))
    trims = trim_points(steady, parameters(2, aero__drag=np.array([1.0, 1.1])))
    memory, controls, path = trims.points.memory, trims.points.controls, trims.points.path
    assert list(law_memory_rows(steady)) == ["speed", "pitch_rate"]
    np.testing.assert_allclose(
        memory[:, 1], path[:, 8], atol=1e-9
    )  # the filter has settled, though no loop asks it to
    throttle = steady.reference[0, 10] - 0.001 * memory[:, 0]
    np.testing.assert_allclose(
        throttle, controls[:, 3], rtol=1e-6
    )  # the integral holds the throttle
    assert memory[1, 0] < memory[0, 0] - 10.0


def forget(file):
    """The law in a controller's file without its memory."""
    law = file.with_suffix(".py")
    text = law.read_text().replace(", memory, time, dt", "").replace("- 0.001 * memory.speed", "")
    text = text.replace(
        "memory.pitch_rate + dt / 0.02 * (measured.pitch_rate - memory.pitch_rate)",
        "measured.pitch_rate",
    )
    law.write_text(text.replace(", Memory(memory.speed + dt * speed, pitch_rate)", ""))
    return file


@pytest.mark.parametrize(
    "write", [write_filtered, lambda *words: forget(write_filtered(*words))], ids=["memory", "none"]
)
def test_plain_python_has_the_margins_of_the_compiled_law(tmp_path, write):
    """A law without a memory was not called: margins were those of a constant command."""
    dispersions, results = parameters(), []
    for compiled in ("", "(compiled=False)"):
        _, plan = plans_of(write(tmp_path, compiled))
        for points in (trim_points(plan, dispersions), flown_points(plan, dispersions, 0.2)):
            results.append((points.points.memory, stability(plan, points, dispersions).margins))
    for (memory, margins), (other_memory, other_margins) in zip(
        results[:2], results[2:], strict=True
    ):
        np.testing.assert_array_equal(memory, other_memory)
        np.testing.assert_array_equal(
            decibels(margins.gain_high), decibels(other_margins.gain_high)
        )
        np.testing.assert_array_equal(margins.all_disk, other_margins.all_disk)


def test_a_memory_that_is_any_object_is_refused(tmp_path):
    _, steady = plans_of(write_filtered(tmp_path, "(compiled=False)", ""))
    with pytest.raises(InputError, match=r"law\.py.*\bNamedTuple\b"):
        trim_points(steady, parameters())


def test_the_time_is_that_of_the_point(tmp_path):
    plan, _ = plans_of(write_filtered(tmp_path, pitch="(1.5 if time > 0.995 else 0.0)"))
    slopes = [
        linearize(plan, flown_points(plan, parameters(), t).points).law_D[0, 2, 8] for t in (0.9, 1)
    ]
    np.testing.assert_allclose(slopes, [0.0, 1.5 * 0.01 / 0.02], rtol=1e-6, atol=1e-12)


def test_a_law_without_slopes_has_no_margins(tmp_path):
    """A square root of the altitude error is not a number below the reference altitude."""
    plan, steady = plans_of(
        write_filtered(
            tmp_path, altitude="(1.0 + 1e-9 * sqrt(measured.altitude - reference.altitude))"
        )
    )
    margins = margins_of_flights(plan, steady, parameters(), ["trim"])
    assert margins.faults == [[NO_SLOPES]] and margins.table[0, 0] == 0.0


def test_a_law_behind_its_own_limit_at_the_trim_is_linearized_where_it_comes_to_rest():
    plan, steady = plans_of(CONFIGS / "f16_autopilot.yaml", "f16_level", "f16", 60.0)
    # Centre of gravity and lift each at an end: at no error of altitude the autopilot asks for all
    # of the elevator.
    side = np.array([-0.09, 0.09])
    dispersions = parameters(2, mass__center_of_gravity_x=side, aero__lift=np.array([1.1, 0.9]))
    points = trim_points(steady, dispersions)
    assert stability(steady, points, dispersions).stable.all()
    flown = fly(plan, dispersions, record_every=100, keep_states=True).states[:, -1, s.ALTITUDE]
    np.testing.assert_allclose(points.points.path[:, 0], flown, atol=0.01)
    assert np.all(
        np.abs(points.points.path[:, 0] - plan.initial_state[s.ALTITUDE]) > 2.0
    )  # an error of its own, in m


@pytest.mark.parametrize("law", ["cascade.yaml", "cascade_c/cascade_c.yaml"])
def test_the_laws_that_new_writes_have_customary_margins_on_the_default_vehicle(law):
    _, plan = plans_of(CONFIGS / law, vehicle="abhv")
    margins = analyse(linearize(plan, trim_points(plan, parameters()).points)).margins
    assert (
        decibels(np.minimum(margins.gain_high, 1.0 / np.maximum(margins.gain_low, 1e-6))).min()
        > 6.0
    )
    assert np.rad2deg(margins.phase).min() > 45.0


ATTITUDE_HOLD = """
from abhv_mc.extend import Command, controller, wrap

@controller
def law(measured, reference):
    alpha = measured.angle_of_attack - reference.angle_of_attack
    elevator = reference.elevator + 2.0 * alpha + 1.5 * measured.pitch_rate
    bank, beta, p, r = wrap(measured.bank - reference.bank), measured.sideslip, \
measured.roll_rate, measured.yaw_rate
    aileron = -0.26 * bank - 1.2 * beta - 0.08 * p + 0.06 * r
    rudder = -0.04 * bank - 0.2 * beta - 0.01 * p + 0.04 * r
    return Command(aileron, rudder, elevator, reference.equivalence_ratio)
"""


def test_an_attitude_hold_has_margins_with_the_slow_states_held(tmp_path):
    given = "level", "ghame_x", write_law(tmp_path, ATTITUDE_HOLD)
    free, held = (
        abhv_mc.margins(*given, hold=hold) for hold in ((), ("altitude", "speed", "heading"))
    )
    assert not free.attrs["stable"] and held.attrs["stable"]
    assert len(free.attrs["poles"]) - len(held.attrs["poles"]) == 3
    assert 3.0 < held.loc["elevator", "gain_margin_high_db"] < np.inf
    (note,) = [text for text in held.attrs["warnings"] if "held" in text]
    assert f"{free.attrs['poles'][0].real:+.2g}" in note
    with pytest.raises(InputError, match="hold: unknown name 'pitch'"):
        abhv_mc.margins(*given, hold=("pitch",))
