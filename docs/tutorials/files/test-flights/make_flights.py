"""Simulated records of six test flights of two vehicles, whose drag is 25 and 30 % too high."""

import numpy as np
import pandas as pd

import abhv_mc

NOISE = {"angle_of_attack_deg": 0.05, "equivalence_ratio": 0.005}
draw = np.random.default_rng(1)
flights = pd.DataFrame({"vehicle": ["A", "A", "A", "B", "B", "B"]})
flights["history"] = [f"flight_{k}.csv" for k in range(6)]
inputs = pd.DataFrame(
    {
        "aero.drag": flights["vehicle"].map({"A": 1.25, "B": 1.30}),
        "aero.lift": flights["vehicle"].map({"A": 1.02, "B": 1.06}),
        "atmosphere.density": draw.uniform(0.95, 1.05, 6),
    }
)
flown = abhv_mc.simulate("study/campaign.yaml", inputs, ["tlc"], list(NOISE))
for k, name in enumerate(flights["history"]):
    record = {"time": flown["time"].to_numpy() + (3.2 if k == 1 else 0.0)}  # one clock is ahead
    for channel, sigma in NOISE.items():
        values = flown[channel].to_numpy()[0, k]
        record[channel] = np.round(values + sigma * draw.standard_normal(values.size), 4)
    pd.DataFrame(record).to_csv(name, index=False)
flights.to_csv("flights.csv", index=False)
