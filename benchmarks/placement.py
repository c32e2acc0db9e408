"""False alarms and detections of `place`: python benchmarks/placement.py [--smoke]

The campaigns simulate a point mass that holds altitude and speed in gusts. Density, lift, drag (5 %
each, normal) and the initial state are dispersed. The measurement noise is that of air data: 1 m/s,
5 m, 0.1 deg, 0.005.
"""

import sys

import numpy as np

from abhv_mc.analysis.place import CONFIDENCE, summarize
from abhv_mc.statistics.placement import joint_p_value, set_p_value, simultaneous_band

CAMPAIGNS, FLIGHTS = 20, 1000
HONEST, WRONG, SETS, IN_SET = 100, 20, 5, 10  # test flights of each campaign
BIAS = 0.2  # deg, of the angle of attack, which is within the usual range
NOISE = np.array([1.0, 5.0, 0.1, 0.005])
_STEP, _TIME = 0.1, 60.0
_SPEED, _ALTITUDE, _MASS, _AREA = 1500.0, 25_000.0, 50_000.0, 200.0


def fly(
    draw: np.random.Generator, flights: int, drag: float | None = None, times: float = 1.0
) -> np.ndarray:
    """Return histories [flight, time, channel] of simulated flights.

    The channels are speed (m/s), altitude (m), angle of attack (deg) and throttle. `drag`, if
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
        if step % 5 == 0:
            rows.append([speed.copy(), altitude.copy(), alpha, throttle])
    return np.transpose(rows, (2, 0, 1))


def study(campaigns: int, flights: int, noise: np.ndarray | None) -> dict[str, float]:
    """Return the shares of test flights that are outside at 5 %."""
    outside: dict[str, list[bool]] = {}
    for seed in range(campaigns):
        draw = np.random.default_rng(seed)

        def run(count: int, **options: float) -> np.ndarray:
            histories = fly(draw, count, **options)  # noqa: B023  called within this loop
            if noise is not None:
                histories += noise * draw.standard_normal(histories.shape)  # noqa: B023
            return histories

        simulated = run(flights)
        band, values = simultaneous_band(simulated, CONFIDENCE), summarize(simulated)
        biased = np.add(run(WRONG), [0.0, 0.0, BIAS, 0.0])
        tests = {
            "honest": run(HONEST),
            "drag 20 % high": run(WRONG, drag=1.2),
            f"angle of attack {BIAS:g} deg high": biased,
        }
        for name, histories in tests.items():
            for history, row in zip(histories, summarize(histories), strict=True):
                p_value = joint_p_value(np.vstack([values, row]))
                leaves = bool(band.deviations(history).max() > band.factor)
                outside.setdefault(f"{name}, metrics", []).append(p_value <= 1.0 - CONFIDENCE)
                outside.setdefault(f"{name}, band", []).append(leaves)
        for name, times in (("honest", 1.0), ("drag times 1.2", 1.2)):
            for _ in range(SETS):
                histories = run(IN_SET, times=times)
                scores = [band.deviations(history).max() for history in histories]
                pool = np.column_stack(
                    [
                        np.vstack([values, summarize(histories)]),
                        np.append(band.scores, scores),
                    ]
                )
                p_value = set_p_value(pool, IN_SET)
                outside.setdefault(f"{name}, sets of ten", []).append(p_value <= 1.0 - CONFIDENCE)
    return {name: float(np.mean(flags)) for name, flags in outside.items()}


def main() -> None:
    """Print the shares without noise and with declared noise."""
    smoke = sys.argv[1:] == ["--smoke"]
    campaigns, flights = (1, 100) if smoke else (CAMPAIGNS, FLIGHTS)
    for label, noise in (("without noise", None), ("with declared noise", NOISE)):
        for name, share in study(campaigns, flights, noise).items():
            print(f"{label}, {name}: outside in {share:.3f}", flush=True)


if __name__ == "__main__":
    main()
