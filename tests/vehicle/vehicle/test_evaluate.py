"""Packed vehicles against explicit formulas on the CSV files."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import RegularGridInterpolator

from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
)

CONFIGS = Path(__file__).parents[3] / "configs" / "vehicle"
N = 300


def look_up(folder, name, *points):
    """Interpolate a CSV file by scipy at points in the units of its columns."""
    frame = pd.read_csv(CONFIGS / folder / f"{name}.csv", comment="#")
    grids = [frame[column].unique() for column in frame.columns[:-1]]
    values = frame["value"].to_numpy().reshape([grid.size for grid in grids])
    clipped = [np.clip(x, grid[0], grid[-1]) for x, grid in zip(points, grids, strict=True)]
    return RegularGridInterpolator(grids, values)(np.stack(np.broadcast_arrays(*clipped), axis=-1))


def draw_state(mach, alpha_deg, seed=3):
    generator = np.random.default_rng(seed)
    state = {
        "mach": generator.uniform(*mach, N),
        "angle_of_attack": np.radians(generator.uniform(*alpha_deg, N)),
        "equivalence_ratio": generator.uniform(0.05, 2.0, N),
    }
    for name, limit in (("sideslip", 0.2), ("aileron", 0.15), ("rudder", 0.3), ("elevator", 0.15)):
        state[name] = generator.uniform(-limit, limit, N)
    for name in ("roll_rate_hat", "pitch_rate_hat", "yaw_rate_hat"):
        state[name] = generator.uniform(-0.01, 0.01, N)
    return state


@pytest.mark.parametrize("name", ["ghame", "ghame_x", "ghame_x_coupled"])
def test_ghame_agrees_with_its_deck(name):
    vehicle = load_vehicle(CONFIGS / f"{name}.yaml")
    s = draw_state((0.3, 26.0), (-5.0, 23.0))  # also beyond the tables, where values are constant
    deg = {
        key: np.degrees(s[key])
        for key in ("angle_of_attack", "sideslip", "aileron", "rudder", "elevator")
    }

    def t(table):
        return look_up("ghame", table, s["mach"], deg["angle_of_attack"])

    beta, da, dr, de = deg["sideslip"], deg["aileron"], deg["rudder"], deg["elevator"]
    p, q, r = s["roll_rate_hat"], s["pitch_rate_hat"], s["yaw_rate_hat"]
    expected = [  # the formulas printed beside the deck
        t("cl_basic") + t("clde") * de,
        t("cd_basic"),
        t("cyb") * beta + t("cyda") * da + t("cydr") * dr,
        t("cllb") * beta + t("cllda") * da + t("clldr") * dr + t("cllp") * p + t("cllr") * r,
        t("cm_basic") + t("cmde") * de + t("cmq") * q,
        t("clnb") * beta + t("clnda") * da + t("clndr") * dr + t("clnp") * p + t("clnr") * r,
    ]
    variables = make_variables(vehicle, **s)
    coefficients = evaluate_coefficients(vehicle, variables)
    assert coefficients == pytest.approx(np.array(expected), rel=1e-11, abs=1e-14)
    engine = evaluate_fixed(vehicle, variables)
    assert engine["capture_area_ratio"] == pytest.approx(t("ca"), rel=1e-12)
    assert engine["specific_impulse"] == pytest.approx(
        look_up("ghame", "spi", s["mach"], s["equivalence_ratio"])
    )
    assert not engine["thrust_area"].any()


def test_winged_cone_is_the_sum_of_its_surfaces():
    vehicle = load_vehicle(CONFIGS / "winged_cone.yaml")
    s = draw_state((3.5, 16.0), (-1.5, 13.0))
    alpha = np.degrees(s["angle_of_attack"])
    right = np.degrees(s["aileron"] - s["elevator"])  # trailing edge up positive, as in the report
    left = np.degrees(-s["aileron"] - s["elevator"])
    rudder = np.degrees(s["rudder"])

    def t(table, *deflection):
        return look_up("winged_cone", table, s["mach"], alpha, *deflection)

    def surfaces(c):
        return (
            t(f"{c}_re", right) + t(f"{c}_le", left) + (t(f"{c}_rud", rudder) if c != "cl" else 0.0)
        )

    beta, p, q, r = s["sideslip"], s["roll_rate_hat"], s["pitch_rate_hat"], s["yaw_rate_hat"]
    expected = [
        t("cl_basic") + surfaces("cl"),
        t("cd_basic") + surfaces("cd"),
        t("cyb") * beta + surfaces("cy"),
        t("crollb") * beta + surfaces("croll") + t("crollp") * p + t("crollr") * r,
        t("cm_basic") + surfaces("cm") + t("cmq") * q,
        t("cnb") * beta + surfaces("cn") + t("cnp") * p + t("cnr") * r,
    ]
    variables = make_variables(vehicle, **s)
    assert evaluate_coefficients(vehicle, variables) == pytest.approx(
        np.array(expected), rel=1e-11, abs=1e-14
    )
    thrust_area = (
        look_up("winged_cone", "thrust_area", s["mach"], s["equivalence_ratio"]) * 0.09290304
    )
    assert evaluate_fixed(vehicle, variables)["thrust_area"] == pytest.approx(thrust_area)


@pytest.mark.parametrize(
    ("name", "mach"), [("ghame", 4.7), ("ghame", 8.0), ("winged_cone", 4.7), ("winged_cone", 15)]
)
def test_deflections_turn_every_vehicle_the_same_way(name, mach):
    vehicle = load_vehicle(CONFIGS / f"{name}.yaml")

    def turn(**deflection):
        point = {"mach": mach, "angle_of_attack": np.radians(3.0)}
        deflected, neutral = (
            evaluate_coefficients(vehicle, make_variables(vehicle, **point, **d))
            for d in (deflection, {})
        )
        return dict(zip(COEFFICIENTS, (deflected - neutral)[:, 0], strict=True))

    assert turn(aileron=0.1)["rolling_moment"] > 0.0  # rolls right
    assert turn(elevator=0.1)["pitching_moment"] < 0.0  # nose down
    assert turn(elevator=0.1)["lift"] > 0.0  # trailing edge down
    assert turn(rudder=0.1)["yawing_moment"] < 0.0  # nose left
    assert turn(rudder=0.1)["side_force"] > 0.0
