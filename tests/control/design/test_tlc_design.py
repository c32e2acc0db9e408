"""Sub-loops 1 and 2 are exact along the reference, and a bandwidth that changes keeps its rate.

Zhu and Shen 2014, equations (5)-(11) and (20).
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from abhv_mc.control.columns import TLC_ATTITUDE, TLC_GAINS, TLC_K1, TLC_K2, TLC_RATE, TLC_SETTINGS
from abhv_mc.control.controller_file import Channel, TlcController, read_controller
from abhv_mc.control.design.design_model import Surroundings, guidance_rates
from abhv_mc.control.design.design_tables import slope
from abhv_mc.control.design.tlc_design import make_tlc_gains, make_tlc_settings, pd_spectrum
from abhv_mc.vehicle.arrays import Tables
from abhv_mc.vehicle.model import Vehicle

Floats = NDArray[np.float64]
CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="module")
def controller() -> TlcController:
    found = read_controller(CONFIGS / "control" / "tlc.yaml")
    assert isinstance(found, TlcController)
    return found


def test_guidance_loops_are_exact_over_the_envelope(
    controller: TlcController, vehicle: Vehicle, trim_tables: Tables, column: dict[str, Floats]
) -> None:
    """``A - B K = A_c`` at random nominals, A and B by complex step of (1); the nominal need not be a trim."""
    generator = np.random.default_rng(5)
    count = 100
    random = {name: value[:count].copy() for name, value in column.items()}
    for name, low, high in (
        ("speed", 1290.0, 1500.0),
        ("flight_path_angle", -0.3, 0.3),
        ("heading", -3.0, 3.0),
        ("angle_of_attack", -0.02, 0.20),
        ("bank", -1.2, 1.2),
        ("equivalence_ratio", 0.1, 1.4),
        ("mass", 900.0, 1400.0),
        ("latitude", -0.9, 0.9),
    ):
        random[name] = generator.uniform(low, high, count)
    rows = np.stack([random[name] for name in column], axis=1)
    gains = make_tlc_gains(controller, rows, vehicle, trim_tables)
    velocity = controller.velocity
    wanted = np.zeros((6, 6))
    wanted[0::2, 1::2] = np.eye(3)
    for i, channel in enumerate((velocity.flight_path_angle, velocity.heading, velocity.speed)):
        assert isinstance(channel.bandwidth, float)
        wanted[2 * i + 1, 2 * i] = -(channel.bandwidth**2)
        wanted[2 * i + 1, 2 * i + 1] = -2.0 * channel.damping * channel.bandwidth
    for k in range(count):
        here = {name: float(value[k]) for name, value in random.items()}
        around = Surroundings(
            here["altitude"], here["density"], here["sound_speed"], here["gravity"], here["radius"], here["latitude"]
        )
        names = ("flight_path_angle", "heading", "speed", "angle_of_attack", "bank", "equivalence_ratio")
        at = [here["altitude"], *(here[name] for name in names)]
        mass = here["mass"]

        def rates_of(x: NDArray[Any], around: Surroundings = around, mass: float = mass) -> NDArray[Any]:
            return guidance_rates(vehicle, trim_tables, around, mass, x[:4], x[4:])

        J = slope(rates_of, at)
        # Sub-loop 1: altitude rate is V cos(gamma) times the flight path angle.
        K1 = gains[k, TLC_K1 : TLC_K1 + 2]
        altitude = controller.altitude
        assert isinstance(altitude.bandwidth, float)
        closed = -J[0, 1] * K1
        np.testing.assert_allclose(
            closed, [-(altitude.bandwidth**2), -2.0 * altitude.damping * altitude.bandwidth], rtol=1e-9
        )
        A, B = np.zeros((6, 6)), np.zeros((6, 3))
        A[0::2, 1::2] = np.eye(3)
        A[1::2, 1::2], B[1::2] = J[1:, 1:4], J[1:, 4:]
        K2 = gains[k, TLC_K2 : TLC_K2 + 18].reshape(3, 6)
        np.testing.assert_allclose(A - B @ K2, wanted, atol=1e-9 * np.abs(B @ K2).max())


def test_gains_of_the_inner_loops_are_table_1(
    controller: TlcController, vehicle: Vehicle, trim_tables: Tables, reference: Floats
) -> None:
    """Zhu and Shen 2014, table 1: 3.4 and 0.3; 3.4 and 1.2, 1.2, 1.5."""
    gains = make_tlc_gains(controller, reference, vehicle, trim_tables)
    assert gains.shape == (len(reference), len(TLC_GAINS))
    np.testing.assert_allclose(gains[:, TLC_ATTITUDE : TLC_ATTITUDE + 6], [[0.09, 2.04] * 3] * len(gains))
    np.testing.assert_allclose(gains[0, TLC_RATE : TLC_RATE + 6], [1.44, 8.16, 1.44, 8.16, 2.25, 10.2])
    settings = dict(zip(TLC_SETTINGS, make_tlc_settings(controller), strict=True))
    assert settings["attitude_differentiator"] == 0.3
    assert settings["rate_differentiator"] == 1.5
    assert np.rad2deg(settings["angle_of_attack_max"]) == pytest.approx(12.0)
    assert np.rad2deg(settings["bank_max"]) == pytest.approx(70.0)


def scheduled(damping: float, over: str, key: str, unit: str, points: tuple[tuple[float, float], ...]) -> Channel:
    entries = [{key: f"{x} {unit}", "bandwidth": f"{wn} rad/s"} for x, wn in points]
    return Channel.model_validate_json(json.dumps({"damping": damping, "bandwidth": {over: entries}}))


def test_a_bandwidth_over_time_keeps_its_rate() -> None:
    channel = scheduled(2.0, "over_time", "time", "s", ((10.0, 0.2), (20.0, 0.4), (40.0, 0.1)))
    times = np.arange(0.0, 60.0, 0.01)
    a1, a2 = pd_spectrum(channel, times, np.ones(times.size))
    for t, wn, rate in ((5.0, 0.2, 0.0), (10.0, 0.2, 0.02), (15.0, 0.3, 0.02), (20.0, 0.4, -0.015), (50.0, 0.1, 0.0)):
        k = round(t / 0.01)
        assert a1[k] == pytest.approx(wn**2)
        assert a2[k] == pytest.approx(4.0 * wn - rate / wn)


def test_the_rate_of_the_bandwidth_makes_the_loop_of_the_wanted_shape() -> None:
    """What the term is for: ``x'' = -a2 x' - a1 x`` has the solutions of constant bandwidth in the time int wn dt."""
    from scipy.integrate import solve_ivp

    channel = scheduled(1.5, "over_time", "time", "s", ((0.0, 0.5), (20.0, 2.0)))

    def rates(t: float, x: Floats) -> list[float]:
        a1, a2 = pd_spectrum(channel, np.array([t]), np.ones(1))
        return [x[1], float(-a1[0] * x[0] - a2[0] * x[1])]

    found = solve_ivp(rates, (0.0, 15.0), [1.0, 0.0], rtol=1e-10, atol=1e-12).y[0, -1]
    stretched = 0.5 * 15.0 + 0.075 * 15.0**2 / 2.0
    roots = np.roots([1.0, 3.0, 1.0])
    shares = np.linalg.solve(np.array([[1.0, 1.0], roots]), [1.0, 0.0])
    assert found == pytest.approx(float(shares @ np.exp(roots * stretched)), rel=1e-6)


def test_a_bandwidth_over_dynamic_pressure_follows_the_reference() -> None:
    channel = scheduled(1.0, "over_dynamic_pressure", "dynamic_pressure", "Pa", ((50e3, 0.1), (100e3, 0.3)))
    times = np.linspace(0.0, 10.0, 1001)
    pressure = 60e3 + 2e3 * times
    a1, a2 = pd_spectrum(channel, times, pressure)
    wn, rate = 0.1 + 0.2 * (pressure - 50e3) / 50e3, 0.2 * 2e3 / 50e3
    np.testing.assert_allclose(a1, wn**2)
    np.testing.assert_allclose(a2, 2.0 * wn - rate / wn, rtol=1e-9)
