"""Tests of TLC's loops.

They are exact, ``A - B K`` at random nominals; the plant is compared with the design model.

The plant is the compiled one, asked at states a little apart. What the design model leaves out is
taken away, the damping by the rates and the Earth's rotation and shape, to see what each is worth.
"""

from dataclasses import replace

import numpy as np
from verification.nominals import (
    SPHERE,
    attitude_jacobian,
    draw_nominals,
    inertia_of,
    make_design,
    rate_jacobian,
    velocity_jacobian,
)
from verification.shown import check

from abhv_mc.flights.timing import Timing
from abhv_mc_vehicle.control.design.design_model import body_rate_rates
from abhv_mc_vehicle.control.design.tlc_design import make_tlc_gains, pd_spectrum
from abhv_mc_vehicle.control.design.trim_tables import trim_elevator
from abhv_mc_vehicle.flight.fly import fly_until, nominal_parameters
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE, TLC_K1, TLC_K2
from abhv_mc_vehicle.kernel.laws.tlc_loops import (
    Inertia,
    Spectrum,
    attitude_gains,
    differentiator_next,
    differentiator_output,
    moment_inverse,
    rate_gains,
)
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, BuildUp
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.probe import ask_plant, begin
from benchmarks.verification.check_rows import Row
from benchmarks.verification.fly_recording import make_replay_plan

NOMINALS = 100
LOOPS = ("2 velocity", "3 attitude", "4 body rates")
EARTH_RATE = 7.3e-5  # rad/s
# Of the two inner loops: all different, so that no two channels can be swapped.
_DIFFERENT = Spectrum(0.09, 2.04, 0.16, 1.9, 0.25, 1.7)
_EXACT = 1e-9  # relative to the largest term of what is summed
_COORDINATES = [
    path.GAMMA,
    path.CHI,
    path.SPEED,
    path.ALPHA,
    path.BETA,
    path.BANK,
    path.P,
    path.Q,
    path.R,
]
_MOVED = [*_COORDINATES, len(path.COORDINATES) + 2]  # and the elevator
_STEPS = (
    np.eye(len(path.COORDINATES) + 4)[_MOVED]
    * np.where(np.array(_MOVED) == path.SPEED, 1e-2, 1e-5)[:, np.newaxis]
)


def closed_loop(A, B, K):
    """``A - B K`` on (integral, state) of each channel."""
    n = len(A)
    augmented_A, augmented_B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, B.shape[1]))
    augmented_A[0::2, 1::2] = np.eye(n)
    augmented_A[1::2, 1::2] = A
    augmented_B[1::2] = B
    return augmented_A - augmented_B @ K


def off(J, K, spectrum):
    """Return the largest difference of ``A - B K`` from A_c of (10).

    It is relative to the largest term of the sum.
    """
    A, B = J[:, :3], J[:, 3:]
    expected = closed_loop(
        np.zeros((3, 3)), -np.eye(3), -np.kron(np.eye(3), np.ones((1, 2))) * np.array(spectrum)
    )
    scale = max(np.abs(A).max(), np.abs(B @ K).max())
    return float(np.abs(closed_loop(A, B, K) - expected).max() / scale)


def outer_gains(design, nominal):
    """The gains that the product's own design gives altitude and velocity at a nominal."""
    row = dict(zip(REFERENCE, design.reference[0].tolist(), strict=True))
    row |= {name: nominal.values[name] for name in REFERENCE if name in nominal.values}
    row |= {
        name: getattr(nominal.around, name)
        for name in ("density", "sound_speed", "gravity", "radius")
    }
    return make_tlc_gains(
        design.tlc, np.array([list(row.values())] * 2), design.vehicle, design.trim_tables
    )[0]


def loops_off(design, nominal):
    """Return the deviations of each sub-loop, and of the moment inverted by (3)."""
    tlc, rates, matrix = design.tlc, nominal.rates, inertia_of(design, nominal)
    inertia = Inertia(matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[0, 2])
    channels = (
        tlc.velocity.flight_path_angle,
        tlc.velocity.heading,
        tlc.velocity.speed,
        tlc.altitude,
    )
    *velocity, altitude = [
        [float(a[0]) for a in pd_spectrum(channel, np.zeros(2), np.ones(2))] for channel in channels
    ]
    outer, J = outer_gains(design, nominal), velocity_jacobian(design, nominal)
    attitude = np.array(attitude_gains(nominal.attitude, rates[0], rates[2], _DIFFERENT)).reshape(
        3, 6
    )
    acceleration = (0.3, -0.2, 0.1)
    moment = moment_inverse(inertia, *rates, *acceleration)
    rates_of_change = np.real(body_rate_rates(matrix, np.array(moment), np.array(rates)))
    return {
        "1 altitude": float(np.abs(J[0, 1] * outer[TLC_K1 : TLC_K1 + 2] / altitude - 1.0).max()),
        "2 velocity": off(
            J[1:, 1:],
            outer[TLC_K2 : TLC_K2 + 18].reshape(3, 6),
            Spectrum(*np.concatenate(velocity)),
        ),
        "3 attitude": off(attitude_jacobian(design, nominal), attitude, _DIFFERENT),
        "4 body rates": off(
            rate_jacobian(matrix, rates, moment),
            np.array(rate_gains(inertia, *rates, _DIFFERENT)).reshape(3, 6),
            _DIFFERENT,
        ),
        "(3) inverted": float(np.abs(rates_of_change - acceleration).max()),
    }


def test_the_loops_are_exact():
    design = make_design()
    results = [loops_off(design, nominal) for nominal in draw_nominals(design, NOMINALS)]
    case, against = f"TLC, {NOMINALS} nominals", "A_c of (10), complex step"
    rows = [
        Row(case, against, name, "relative", max(result[name] for result in results), _EXACT)
        for name in results[0]
    ]
    check([*rows[:-1], replace(rows[-1], unit="rad/s2", tolerance=1e-12)])


def test_the_differentiator():
    """The pseudo-differentiator's response to sampled sines against (21), ``wd s / (s + wd)``."""
    tick, worst = 0.01, 0.0
    for bandwidth in (0.3, 1.5):
        decay = float(np.exp(-bandwidth * tick))
        for omega in (0.03, 0.3, 3.0):
            # The discrete filter's own transfer function, from its impulse response.
            state, response = 0.0, []
            for k in range(round(20.0 / bandwidth / tick)):
                u = 1.0 if k == 0 else 0.0
                response.append(differentiator_output(bandwidth, state, u))
                state = differentiator_next(decay, state, u)
            derivative = np.sum(
                np.array(response) * np.exp(-1j * omega * tick * np.arange(len(response)))
            )
            expected = bandwidth * 1j * omega / (1j * omega + bandwidth)
            # Holding the input delays the filtered part by half a tick.
            worst = max(worst, float(abs(derivative - expected)) / (0.5 * omega * tick * bandwidth))
    check(
        [
            Row(
                "differentiator, 100 Hz",
                "(21)",
                "frequency response",
                "of half a tick's delay",
                worst,
                1.1,
            )
        ]
    )


def without_damping(vehicle):
    """Return the vehicle without body-rate terms in its tables."""
    terms = vehicle.build_up
    rates = [VARIABLES.index(name) for name in ("roll_rate_hat", "pitch_rate_hat", "yaw_rate_hat")]
    is_unrelated = ~np.isin(terms.variable, rates)
    return vehicle._replace(build_up=BuildUp(*(column[is_unrelated] for column in terms)))


def plant_off(design, nominal, vehicle, earth):
    """Return the largest differences between the plant's matrices and the design's.

    Entries of A and of attitude [A B] in each of LOOPS, 1/s with speeds over the nominal.
    """
    J = plant_jacobian(nominal, vehicle, earth)
    # Guidance flies on the data at trim: in sub-loop 2 the elevator follows the speed.
    by_speed = J[:3, 2] + J[:3, 9] * trim_slope(design.vehicle, nominal)
    scale = np.array([1.0, 1.0, nominal.values["speed"]])
    velocity = np.column_stack([J[:3, :2], by_speed]) - velocity_jacobian(design, nominal)[1:, 1:4]
    velocity *= scale / scale[:, None]
    attitude = J[3:6, 3:9] - attitude_jacobian(design, nominal)
    rates = (
        J[6:, 6:9]
        - rate_jacobian(inertia_of(design, nominal), nominal.rates, (0.0, 0.0, 0.0))[:, :3]
    )
    return [float(np.abs(block).max()) for block in (velocity, attitude, rates)]


def plant_jacobian(nominal, vehicle, earth):
    """[9, 10]: rates of _COORDINATES over these and the elevator at a nominal."""
    values = nominal.values | dict(
        zip(("roll_rate", "pitch_rate", "yaw_rate"), nominal.rates, strict=True)
    )
    point = [values.get(name, 0.0) for name in path.COORDINATES]  # without sideslip
    controls = [0.0, 0.0, nominal.elevator, values["equivalence_ratio"]]
    points = np.array([*point, *controls]) + np.concatenate([_STEPS, -_STEPS])
    latitude, mass = (np.full(len(points), values[name]) for name in ("latitude", "mass"))
    states = path.make_states(points[:, : len(point)], points[:, len(point) :], latitude, mass)
    plan = make_replay_plan(
        vehicle, earth, states[0], np.tile(controls, (2, 1)), Timing(0.01, 1, 1)
    )
    lane, _ = begin(plan, fly_until(plan, nominal_parameters(), 0))
    rates = path.path_rates(
        states, ask_plant(plan, lane, 0, np.zeros(len(states), np.int64), states).rates
    )
    upward, downward = np.split(rates[:, _COORDINATES], 2)
    return ((upward - downward) / (2.0 * _STEPS.sum(axis=1)[:, np.newaxis])).T


def trim_slope(vehicle, nominal):
    """Slope of the trimmed elevator over speed."""
    speed = nominal.values["speed"] + np.array([1e-2, -1e-2])
    arguments = (
        np.full(2, nominal.values[name]) for name in ("angle_of_attack", "equivalence_ratio")
    )
    elevator = trim_elevator(vehicle, nominal.around, speed, *arguments)
    return float(elevator[0] - elevator[1]) / 2e-2


def test_without_damping_on_a_still_sphere_the_plant_is_the_design_model():
    """Compare differences of the compiled plant with complex steps of the design model.

    The differences are accurate to some 1e-11.
    """
    design = make_design()
    rigid = without_damping(design.vehicle)
    plants = {
        "as flown": (design.vehicle, WGS84),
        "without damping": (rigid, WGS84),
        "on a still sphere": (design.vehicle, SPHERE),
        "both": (rigid, SPHERE),
    }
    nominals = draw_nominals(design, 40, seed=4)
    worst = {
        name: np.max([plant_off(design, nominal, *plant) for nominal in nominals], axis=0)
        for name, plant in plants.items()
    }
    for name, entries in worst.items():
        print(
            " | ".join(
                [name, *(f"{loop} {entry:.1e}" for loop, entry in zip(LOOPS, entries, strict=True))]
            )
        )
    assert (worst["both"][1:] < 1e-9).all()
    # Damping and the Earth are seen where they act.
    assert worst["on a still sphere"][2] > 0.1
    assert 0.1 * EARTH_RATE < worst["without damping"][1] < 3.0 * EARTH_RATE
    assert worst["both"][0] < 1e-3
