"""Gains of sub-loops 1 and 2, and PD spectra with scheduled bandwidth.

Zhu and Shen 2014, equations (5)-(11) and (20).
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from abhv_mc_vehicle.control.controller_file import Channel, TlcController, read_controller
from abhv_mc_vehicle.control.design.tlc_design import make_tlc_gains, make_tlc_settings, pd_spectrum
from abhv_mc_vehicle.kernel.laws.columns import TLC_ATTITUDE, TLC_GAINS, TLC_RATE, TLC_SETTINGS

Floats = NDArray[np.float64]
CONFIGS = Path(__file__).parents[4] / "configs"


@pytest.fixture(scope="module")
def controller():
    controller_file = read_controller(CONFIGS / "control" / "tlc.yaml")
    assert isinstance(controller_file, TlcController)
    return controller_file


def test_gains_of_the_inner_loops_are_table_1(controller, vehicle, trim_tables, reference):
    """Zhu and Shen 2014, table 1: 3.4 and 0.3; 3.4 and 1.2, 1.2, 1.5."""
    gains = make_tlc_gains(controller, reference, vehicle, trim_tables)
    assert gains.shape == (len(reference), len(TLC_GAINS))
    np.testing.assert_allclose(
        gains[:, TLC_ATTITUDE : TLC_ATTITUDE + 6], [[0.09, 2.04] * 3] * len(gains)
    )
    np.testing.assert_allclose(
        gains[0, TLC_RATE : TLC_RATE + 6], [1.44, 8.16, 1.44, 8.16, 2.25, 10.2]
    )
    settings = dict(zip(TLC_SETTINGS, make_tlc_settings(controller, vehicle), strict=True))
    assert settings["attitude_differentiator"] == 0.3
    assert settings["rate_differentiator"] == 1.5
    assert np.rad2deg(settings["angle_of_attack_max"]) == pytest.approx(12.0)
    assert np.rad2deg(settings["bank_max"]) == pytest.approx(70.0)


def scheduled(damping, over, key, unit, points):
    entries = [{key: f"{x} {unit}", "bandwidth": f"{wn} rad/s"} for x, wn in points]
    return Channel(damping=damping, bandwidth={over: entries})


def test_a_bandwidth_over_time_enters_with_its_rate():
    channel = scheduled(2.0, "over_time", "time", "s", ((10.0, 0.2), (20.0, 0.4), (40.0, 0.1)))
    times = np.arange(0.0, 60.0, 0.01)
    a1, a2 = pd_spectrum(channel, times, np.ones(times.size))
    for t, wn, rate in (
        (5.0, 0.2, 0.0),
        (10.0, 0.2, 0.02),
        (15.0, 0.3, 0.02),
        (20.0, 0.4, -0.015),
        (50.0, 0.1, 0.0),
    ):
        k = round(t / 0.01)
        assert a1[k] == pytest.approx(wn**2)
        assert a2[k] == pytest.approx(4.0 * wn - rate / wn)


def test_with_its_rate_a_varying_bandwidth_only_stretches_time():
    """``x'' = -a2 x' - a1 x`` has the solution of constant bandwidth in the time int wn dt."""
    from scipy.integrate import solve_ivp

    channel = scheduled(1.5, "over_time", "time", "s", ((0.0, 0.5), (20.0, 2.0)))

    def rates(t, x):
        a1, a2 = pd_spectrum(channel, np.array([t]), np.ones(1))
        return [x[1], float(-a1[0] * x[0] - a2[0] * x[1])]

    final = solve_ivp(rates, (0.0, 15.0), [1.0, 0.0], rtol=1e-10, atol=1e-12).y[0, -1]
    stretched = 0.5 * 15.0 + 0.075 * 15.0**2 / 2.0
    roots = np.roots([1.0, 3.0, 1.0])
    shares = np.linalg.solve(np.array([[1.0, 1.0], roots]), [1.0, 0.0])
    assert final == pytest.approx(float(shares @ np.exp(roots * stretched)), rel=1e-6)


def test_a_bandwidth_over_dynamic_pressure_follows_the_reference():
    channel = scheduled(
        1.0, "over_dynamic_pressure", "dynamic_pressure", "Pa", ((50e3, 0.1), (100e3, 0.3))
    )
    times = np.linspace(0.0, 10.0, 1001)
    pressure = 60e3 + 2e3 * times
    a1, a2 = pd_spectrum(channel, times, pressure)
    wn, rate = 0.1 + 0.2 * (pressure - 50e3) / 50e3, 0.2 * 2e3 / 50e3
    np.testing.assert_allclose(a1, wn**2)
    np.testing.assert_allclose(a2, 2.0 * wn - rate / wn, rtol=1e-9)
