"""Hold the wings level and the altitude of 20 dispersed flights."""

import numpy as np

import abhv_mc

plant = abhv_mc.Plant(
    "level",
    flights=20,
    dispersions={
        "aero.lift": {"distribution": "uniform", "half_width": "10 %"},
        "initial.bank": {"distribution": "uniform", "low": "-10 deg", "high": "10 deg"},
    },
    channels=["altitude_error_m"],
)
state = plant.reset(seed=1)
trim = dict(zip(plant.commands, plant.nominal, strict=True))
while (state.outcome == "").any():
    m = {name: np.nan_to_num(values) for name, values in state.measured.items()}
    tick = round(state.time / plant.period)
    climb = m["flight_path_angle"] + 2e-4 * (m["altitude"] - plant.reference["altitude"][tick])
    state = plant.step(
        {
            "elevator": trim["elevator"] + 0.8 * climb + 1.5 * m["pitch_rate"],
            "aileron": -0.26 * m["bank"] - 1.2 * m["sideslip"] - 0.08 * m["roll_rate"],
            "rudder": -0.04 * m["bank"] - 0.2 * m["sideslip"],
        }
    )
print(np.unique(state.outcome, return_counts=True))
print(plant.metrics["altitude_error_max_m"].max())
