"""Linear models know what sensors do: lags, samples that are held, scale factors, beside a delay."""

from dataclasses import replace

import numpy as np
import pytest
from stability.systems import assert_predicted, flight_plan, parameters, steady_plan
from stability.test_periods import COUNTER, plan_of

from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.plant.parameter_names import SENSORS
from abhv_mc.stability.analysis import analyse, margins_of_flights
from abhv_mc.stability.linearize import closed_period, linearize
from abhv_mc.stability.margins import loop_gains, make_loops
from abhv_mc.stability.model_file import make_model
from abhv_mc.stability.steady import trim_points


def at_trim(plan, **values):
    found = trim_points(plan, parameters(**values))
    assert found.faults == [""]
    return linearize(plan, found.points), found.points


def of_all(what, value):
    return {f"sensor__{name}_{what}": value for name in SENSORS}


def test_the_linear_models_predict_the_flight():
    late = {"sensor__angle_of_attack_lag": 0.05, "sensor__pitch_rate_lag": 0.02, "sensor__bank_lag": 0.004}
    held = {"sensor__speed_interval": 0.05, "sensor__sideslip_interval": 0.02, "sensor__angle_of_attack_interval": 0.03}
    rest = {"sensor__pitch_rate_scale": 1.3, "sensor__speed_scale": 0.98, "sensor__delay": 0.02}
    assert_predicted(flight_plan("tlc", 10.0), parameters(**late, **held, **rest), 301, 60)


@pytest.mark.parametrize("lag", [0.004, 0.08])
def test_one_lag_of_all_that_is_measured_multiplies_every_loop(lag):
    plan = steady_plan("lqr_retuned")
    without, with_lag = at_trim(plan)[0], at_trim(plan, **of_all("lag", lag))[0]
    assert not with_lag.phases
    omega = np.array([0.3, 3.0, 30.0])
    z, stays, share = np.exp(0.01j * omega), np.exp(-0.01 / lag), (1.0 - np.exp(-0.01 / lag)) * lag / 0.01
    answer = ((1.0 - share) * z + share - stays) / (z - stays)  # 1 / (lag s + 1) with a first-order hold
    before, after = (loop_gains(make_loops(each), np.zeros(3, int), omega) for each in (without, with_lag))
    np.testing.assert_allclose(after, answer[:, None, None] * before, rtol=1e-8)


@pytest.mark.parametrize("late", [0, 2])
def test_samples_that_are_held_and_late_are_the_map_computed_apart(late):
    """A law without memory whose command changes ``late`` ticks after every tenth: [state, command] over ten ticks."""
    plan = steady_plan("lqr_retuned")
    linear, _ = at_trim(plan, **of_all("interval", 0.1), sensor__delay=0.01 * late)
    assert len(linear.phases) == 10
    A, B, D = linear.A[0], linear.B[0], at_trim(plan)[0].law_D[0] @ linear.sense[0]

    def held(ticks):
        inputs = [np.linalg.matrix_power(A, k) @ B for k in range(ticks)]
        return np.linalg.matrix_power(A, ticks), sum(inputs, np.zeros_like(B))

    (A_old, B_old), (A_new, B_new) = held(late), held(10 - late)
    by_hand = np.block([[A_new @ A_old + B_new @ D, A_new @ B_old], [D, np.zeros((4, 4))]])
    poles, others = (np.linalg.eigvals(each) for each in (closed_period(linear, 0), by_hand))
    for pole in others[np.abs(others) > 1e-6]:
        assert np.abs(poles - pole).min() < 1e-8


def test_sensors_and_a_law_repeat_together(tmp_path):
    plan = plan_of(tmp_path, COUNTER)
    linear, points = at_trim(plan, sensor__speed_interval=0.04, sensor__bank_lag=0.02)
    assert len(linear.phases) == 20
    assert make_model(plan, points, linear)["law"]["states"][-2:] == ["bank_late", "speed_held"]
    assert analyse(linear).stable.all()
    with pytest.raises(InputError, match="after 110 ticks"):
        at_trim(plan, sensor__speed_interval=0.11)


def test_intervals_that_differ_between_flights_are_not_linearized_together():
    plan, rows = steady_plan("lqr_retuned"), parameters(2)
    rows[1] = parameters(sensor__speed_interval=0.1)[0]
    with pytest.raises(InputError, match="differ"):
        margins_of_flights(replace(plan), plan, rows, ["trim"])
