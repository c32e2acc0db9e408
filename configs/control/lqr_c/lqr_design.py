"""Gains of the LQR along the mission, one column for each value of enum gain.

The table also has the quantities of the Earth that lqr.c needs.
"""

from collections import namedtuple

WEIGHTS = {  # the paper's (Zhu and Shen 2014), as in lqr.yaml
    "law": "lqr",
    "guidance": {
        "states": {"altitude": 0.1, "flight_path_angle": 5.28e6, "heading": 1.28e6, "speed": 1.0},
        "inputs": {"angle_of_attack": 1.31e4, "bank": 3.28e3, "equivalence_ratio": 1.0e4},
    },
    "longitudinal": {
        "states": {"angle_of_attack": 2.28e7, "pitch_rate": 0.0},
        "inputs": {"elevator": 800.0},
    },
    "lateral": {
        "states": {"bank": 2.28e5, "sideslip": 1.28e7, "roll_rate": 3.28e3, "yaw_rate": 3.28e4},
        "inputs": {"aileron": 1.0e3, "rudder": 3.0e3},
    },
}


def design(model, settings):
    """One row of gains a control tick."""
    gains, earth = model.lqr_gains(WEIGHTS), model.earth
    Gains = namedtuple("Gains", (*gains._fields, "earth_radius", "gravitational_parameter"))
    return Gains(*gains, earth.equatorial_radius, earth.gravitational_parameter)
