"""Simulator of AeroBench's F-16 with ground collision avoidance, from PSY-TaLiRo's example.

AeroBenchVVPython is not a package: copy its folder `code/aerobench` beside this file.
"""

from math import radians

from aerobench.examples.gcas.gcas_autopilot import GcasAutopilot
from aerobench.run_f16_sim import run_f16_sim


def fly(inputs, settings):
    """Simulate 15 s, or until ground impact."""
    angles = [radians(inputs[name]) for name in ("roll", "pitch", "yaw")]
    start = [
        540.0,
        radians(2.1215),
        0.0,
        *angles,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        settings["altitude"],
        9.0,
    ]
    flight = run_f16_sim(start, 15.0, GcasAutopilot(init_mode="roll"), step=1.0 / 30.0)
    return {"altitude_min": float(flight["states"][:, 11].min())}
