"""False alarms and detections of `place`: python benchmarks/placement.py [--smoke]

Two models are simulated:

- a point mass that holds altitude and speed in gusts; density, lift, drag (5 % each, normal) and
  the initial state are dispersed, and
- TLC in the S manoeuvre of the default campaign; density, lift (10 %) and drag (15 %) are uniform.

The measurement noise is that of air data and of an inertial unit.
"""

import sys
from collections.abc import Callable

import numpy as np
import pandas as pd

from abhv_mc.analysis.place import CONFIDENCE, summarize
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.table_simulation import simulate_table
from abhv_mc.shipped import find_input
from abhv_mc.statistics.placement import joint_p_value, set_p_value, simultaneous_band

CAMPAIGNS, FLIGHTS = 20, 1000
HONEST, WRONG, SETS, IN_SET = 100, 20, 5, 10  # test flights of each campaign
WRONG_DRAG = 1.2
BIAS = 0.2  # deg, of the angle of attack, which is within the usual range
NOISE = {
    "angle_of_attack_deg": 0.1,
    "speed_mps": 1.0,
    "altitude_m": 5.0,
    "equivalence_ratio": 0.005,
    "sideslip_deg": 0.1,
    "bank_deg": 0.1,
    "elevator_deg": 0.1,
}
_POINT_MASS_CHANNELS = 4
_STEP, _TIME = 0.1, 60.0
_SPEED, _ALTITUDE, _MASS, _AREA = 1500.0, 25_000.0, 50_000.0, 200.0
_EVERY = 5  # of the histories' times that are used

Fly = Callable[..., np.ndarray]


def fly_manoeuvre(
    draw: np.random.Generator, flights: int, drag: float | None = None, times: float = 1.0
) -> np.ndarray:
    """Return histories [flight, time, channel] of the default campaign, as `fly_point_mass`."""
    campaign = read_campaign(
        find_input("s_manoeuvre", "campaign"), flights, int(draw.integers(1 << 31)), ["tlc"]
    )
    samples = campaign.make_samples()
    inputs = pd.DataFrame(samples.draw(0, flights), columns=list(samples.names))
    if drag is not None:
        inputs["aero.drag"] = drag
    inputs["aero.drag"] *= times
    flown = simulate_table(campaign, inputs, ["tlc"], list(NOISE))
    columns = [flown[name].transpose("flight", "time", ...).to_numpy() for name in NOISE]
    return np.stack([column.reshape(flights, -1)[:, ::_EVERY] for column in columns], axis=2)


def fly_point_mass(
    draw: np.random.Generator, flights: int, drag: float | None = None, times: float = 1.0
) -> np.ndarray:
    """Return histories [flight, time, channel] of simulated flights.

    The channels are angle of attack (deg), speed (m/s), altitude (m) and throttle. `drag`, if
    not None, is the drag factor of all flights; `times` multiplies it.
    """
    density, lift, k_drag = 1.0 + 0.05 * draw.standard_normal((3, flights))
    k_drag = times * (k_drag if drag is None else np.full(flights, drag))
    speed = _SPEED + 5.0 * draw.standard_normal(flights)
    altitude = _ALTITUDE + 30.0 * draw.standard_normal(flights)
    climb, gust = np.zeros(flights), np.zeros(flights)
    pressure = 0.5 * 0.04 * _SPEED**2
    trim = _MASS * 9.81 / (pressure * _AREA * 0.02)  # deg
    thrust = pressure * _AREA * (0.02 + 0.0004 * trim**2)
    rows = []
    for step in range(int(_TIME / _STEP)):
        gust += _STEP / 3.0 * -gust + 3.0 * np.sqrt(2.0 * _STEP / 3.0) * draw.standard_normal(
            flights
        )
        q = density * pressure * ((speed + gust) / _SPEED) ** 2 * _AREA
        command = np.clip(1e-4 * (_ALTITUDE - altitude), -0.01, 0.01)
        alpha = trim + 100.0 * (command - climb)
        throttle = 1.0 + 20.0 * (_SPEED - speed) / _SPEED
        forward = thrust * throttle - k_drag * q * (0.02 + 0.0004 * alpha**2)
        climb += _STEP * (lift * q * 0.02 * alpha - _MASS * 9.81) / (_MASS * speed)
        speed += _STEP * (forward / _MASS - 9.81 * climb)
        altitude += _STEP * speed * climb
        if step % _EVERY == 0:
            rows.append([alpha, speed.copy(), altitude.copy(), throttle])
    return np.transpose(rows, (2, 0, 1))


def study(fly: Fly, campaigns: int, flights: int, noise: np.ndarray) -> dict[str, float]:
    """Return the shares of test flights that are outside at 5 %."""
    outside: dict[str, list[bool]] = {}
    for seed in range(campaigns):
        draw = np.random.default_rng(seed)

        def run(count: int, **options: float) -> np.ndarray:
            histories = fly(draw, count, **options)  # noqa: B023  called within this loop
            return histories + noise * draw.standard_normal(histories.shape)  # noqa: B023

        simulated = run(flights)
        band, values = simultaneous_band(simulated, CONFIDENCE), summarize(simulated)
        biased = run(WRONG)
        biased[:, :, 0] += BIAS
        tests = {
            "valid": run(HONEST),
            "drag 20 % high": run(WRONG, drag=WRONG_DRAG),
            f"angle of attack {BIAS:g} deg high": biased,
        }
        for name, histories in tests.items():
            for history, row in zip(histories, summarize(histories), strict=True):
                p_value = joint_p_value(np.vstack([values, row]))
                leaves = bool(band.deviations(history).max() > band.factor)
                outside.setdefault(f"{name}, metrics", []).append(p_value <= 1.0 - CONFIDENCE)
                outside.setdefault(f"{name}, band", []).append(leaves)
        for name, times in (("valid", 1.0), (f"drag times {WRONG_DRAG:g}", WRONG_DRAG)):
            histories = run(SETS * IN_SET, times=times)
            scores = np.array([band.deviations(history).max() for history in histories])
            own = np.column_stack([summarize(histories), scores])
            for rows in np.split(own, SETS):
                pool = np.vstack([np.column_stack([values, band.scores]), rows])
                p_value = set_p_value(pool, IN_SET)
                outside.setdefault(f"{name}, sets of ten", []).append(p_value <= 1.0 - CONFIDENCE)
    return {name: float(np.mean(flags)) for name, flags in outside.items()}


def main() -> None:
    """Print the shares of both models without noise and with declared noise."""
    smoke = sys.argv[1:] == ["--smoke"]
    campaigns, flights = (1, 100) if smoke else (CAMPAIGNS, FLIGHTS)
    noise = np.array([*NOISE.values()])
    models = {
        "point mass": (fly_point_mass, noise[:_POINT_MASS_CHANNELS]),
        "S manoeuvre": (fly_manoeuvre, noise),
    }
    labels = (("without noise", 0.0), ("with declared noise", 1.0))
    for model, (fly, sigma) in models.items():
        for label, factor in labels[: 1 if smoke else None]:
            for name, share in study(fly, campaigns, flights, factor * sigma).items():
                print(f"{model}, {label}, {name}: outside in {share:.3f}", flush=True)


if __name__ == "__main__":
    main()
