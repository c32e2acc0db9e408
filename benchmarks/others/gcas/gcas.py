"""AeroBench's F-16 and its ground collision avoidance, from the start of PSY-TaLiRo's example of it.

AeroBenchVVPython is no package: its folder `code` has to stand in PYTHONPATH.
"""

from math import radians

from aerobench.examples.gcas.gcas_autopilot import GcasAutopilot
from aerobench.run_f16_sim import run_f16_sim


def fly(inputs, settings):
    """15 s, or to the ground."""
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
