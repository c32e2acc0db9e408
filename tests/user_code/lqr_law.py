"""The program's own LQR, written as a law of one's own: the proof that nothing is lost by the call."""

from typing import NamedTuple

import numpy as np

from abhv_mc.control.controller_file import LqrController
from abhv_mc.control.design.lqr_design import make_lqr_gains
from abhv_mc.extend import Command, clamp, controller, sincos, wrap
from abhv_mc.kernel.laws.columns import LQR_GAINS

WEIGHTS = {
    "law": "lqr",
    "guidance": {
        "states": {"altitude": 0.1, "flight_path_angle": 5.28e6, "heading": 1.28e6, "speed": 1.0},
        "inputs": {"angle_of_attack": 1.31e4, "bank": 3.28e3, "equivalence_ratio": 1.0e4},
    },
    "longitudinal": {"states": {"angle_of_attack": 2.28e7, "pitch_rate": 0.0}, "inputs": {"elevator": 800.0}},
    "lateral": {
        "states": {"bank": 2.28e5, "sideslip": 1.28e7, "roll_rate": 3.28e3, "yaw_rate": 3.28e4},
        "inputs": {"aileron": 1.0e3, "rudder": 3.0e3},
    },
}


class Settings(NamedTuple):
    """Limits of the commands."""

    lowest: float = -0.017453292519943295
    highest: float = 0.20943951023931956
    bank: float = 1.2217304763960306


OTHERS = ("lowest_ratio", "highest_ratio", "earth_radius", "gravitational_parameter")
Gains = NamedTuple("Gains", [(name, np.ndarray) for name in (*LQR_GAINS, *OTHERS)])


def design(model, settings):
    gains = make_lqr_gains(LqrController(**WEIGHTS), model.mission, model.table, model.vehicle, model.trim_tables)
    constants, earth = model.vehicle.constants, model.earth
    limits = constants.equivalence_ratio_min, constants.equivalence_ratio_max
    return Gains(*gains.T, *limits, earth.equatorial_radius, earth.gravitational_parameter)


@controller(units={"lowest": "rad", "highest": "rad", "bank": "rad"})
def law(measured, reference, settings, gains):
    altitude = measured.altitude - reference.altitude
    path = measured.flight_path_angle - reference.flight_path_angle
    heading = wrap(measured.heading - reference.heading)
    speed = measured.speed - reference.speed
    alpha = (
        gains.angle_of_attack_by_altitude * altitude
        + gains.angle_of_attack_by_path * path
        + gains.angle_of_attack_by_heading * heading
        + gains.angle_of_attack_by_speed * speed
    )
    bank = (
        gains.bank_by_altitude * altitude
        + gains.bank_by_path * path
        + gains.bank_by_heading * heading
        + gains.bank_by_speed * speed
    )
    eta = (
        gains.equivalence_ratio_by_altitude * altitude
        + gains.equivalence_ratio_by_path * path
        + gains.equivalence_ratio_by_heading * heading
        + gains.equivalence_ratio_by_speed * speed
    )
    alpha_cmd = clamp(reference.angle_of_attack - alpha, settings.lowest, settings.highest)
    bank_cmd = clamp(reference.bank - bank, -settings.bank, settings.bank)
    radius = gains.earth_radius + measured.altitude
    gravity_speed = gains.gravitational_parameter / (radius * radius * measured.speed)
    sin_bank, cos_bank = sincos(bank_cmd)
    sin_alpha, cos_alpha = sincos(alpha_cmd)
    turn = gravity_speed * sin_bank
    pitch_rate = measured.pitch_rate - turn * sin_bank / cos_bank
    roll_rate = measured.roll_rate + turn * sin_alpha
    yaw_rate = measured.yaw_rate - turn * cos_alpha
    alpha_err = measured.angle_of_attack - alpha_cmd
    bank_err = wrap(measured.bank - bank_cmd)
    beta = measured.sideslip
    return Command(
        aileron=-(
            gains.aileron_by_bank * bank_err
            + gains.aileron_by_sideslip * beta
            + gains.aileron_by_roll_rate * roll_rate
            + gains.aileron_by_yaw_rate * yaw_rate
        ),
        rudder=-(
            gains.rudder_by_bank * bank_err
            + gains.rudder_by_sideslip * beta
            + gains.rudder_by_roll_rate * roll_rate
            + gains.rudder_by_yaw_rate * yaw_rate
        ),
        elevator=reference.elevator
        - (gains.elevator_by_angle_of_attack * alpha_err + gains.elevator_by_pitch_rate * pitch_rate),
        equivalence_ratio=clamp(reference.equivalence_ratio - eta, gains.lowest_ratio, gains.highest_ratio),
        flight_path_angle=reference.flight_path_angle,
        angle_of_attack=alpha_cmd,
        bank=bank_cmd,
    )
