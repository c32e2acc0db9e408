"""Gains of the LQR along the mission, one column for each value of enum gain.

The table also has the quantities of the Earth that lqr.c needs.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.control.controller_file import LqrController
from abhv_mc.control.design.lqr_design import make_lqr_gains
from abhv_mc.kernel.laws.columns import LQR_GAINS

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

EARTH = ("earth_radius", "gravitational_parameter")
Gains = NamedTuple("Gains", [(name, np.ndarray) for name in (*LQR_GAINS, *EARTH)])


def design(model, settings):
    """One row of gains a control tick."""
    gains = make_lqr_gains(
        LqrController(**WEIGHTS), model.mission, model.table, model.vehicle, model.trim_tables
    )
    return Gains(*gains.T, model.earth.equatorial_radius, model.earth.gravitational_parameter)
