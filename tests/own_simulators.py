"""Custom simulators and campaigns that use them."""

import json
import re
from typing import Any

import numpy as np

DIVE = """
import json, math, os, sys, time

def fly(inputs, settings):
    v, dive, pull = inputs["speed"], math.radians(inputs["dive"]), settings.get("pull", 5.0)
    radius = v * v / (32.174 * (pull - 1.0) * inputs["thrust"])
    low = inputs["altitude"] - v * math.sin(dive) * inputs["delay"] - radius * (1.0 - \
math.cos(dive))
    found = {"altitude_min": low, "load": pull * inputs["thrust"]}
    if low < -200.0:
        found |= {"outcome": "ground", "end_time": 12.5}
    return found
"""

# The same with histories: samples lie anywhere, begin before 0 or after it, and lack numbers where
# it ended early.
DIVE_HISTORY = (
    DIVE
    + """
import random
well = fly

def scattered(inputs):
    draw = random.Random(inputs["altitude"])
    time, times = draw.uniform(-1.0, 0.6), []
    for _ in range(draw.randrange(1, 30)):
        times.append(time)
        time += draw.choice((0.001, 0.02, 0.4, 1.3))
    return {"time": times, **{name: [draw.gauss(0.0, 9.0) for _ in times] for name in \
("altitude", "sink_rate")}}

def fly(inputs, settings):
    found, history = well(inputs, settings), scattered(inputs)
    if found["altitude_min"] < 200.0:
        found["outcome"], history["altitude"][-1] = "ground", None
    return found | {"history": history}
"""
)
DIVE_CHANNELS = {
    "altitude": {"unit": "ft", "doc": "above the ground"},
    "sink_rate": {"unit": "ft/s"},
}


def write_study(folder, source, **changes):
    """Write a campaign with two inputs and the metric ``total``; ``source`` is its simulator."""
    folder.mkdir(exist_ok=True)
    (folder / "sim.py").write_text(source)
    content: dict[str, Any] = {
        "name": "study",
        "question": "Does it hold?",
        "simulator": {"python": "sim.py"},
        "inputs": {name: {"unit": "m", "nominal": 5} for name in "ab"},
        "dispersions": {name: {"distribution": "normal", "sigma": "1 m"} for name in "ab"},
        "metrics": {"total": {"unit": "m", "bad": "high"}},
        "requirements": [
            {"id": "R1", "metric": "total", "below": "11 m", "probability": "90 %"},
        ],
        "runs": 20,
    }
    path = folder / "study.yaml"
    path.write_text(json.dumps(content | changes))
    return path


def dive_campaign(folder, source=DIVE, **changes):
    """Write a campaign of a dive recovery with the simulator ``source``; None removes a key."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "dive.py").write_text(source)
    content: dict[str, Any] = {
        "name": "dive",
        "simulator": {"python": "dive.py", "time_limit": "30 s"},
        "systems": {"v1": {"pull": 5.0}, "v2": {"pull": 6.0}},
        "inputs": {
            "altitude": {"unit": "ft", "nominal": 2330.0},
            "speed": {"unit": "ft/s", "nominal": 560.0},
            "dive": {"unit": "deg", "nominal": 60.0},
            "delay": {"unit": "s", "nominal": 1.5},
            "thrust": {"unit": "-", "nominal": 1.0},
        },
        "dispersions": {
            "altitude": {"distribution": "normal", "sigma": "50 ft"},
            "speed": {"distribution": "normal", "sigma": "5 %"},
            "delay": {"distribution": "uniform", "low": 1.0, "high": "2200 ms"},
            "thrust": {"distribution": "normal", "sigma": "3 %"},
        },
        "metrics": {
            "altitude_min": {"unit": "ft", "bad": "low", "label": "lowest altitude"},
            "load": {"unit": "g", "label": "load factor"},
        },
        "outcomes": {"ground": "It came below the ground."},
        "requirements": [
            {"id": "GC-1", "metric": "altitude_min", "above": "0 ft", "probability": "99 %"},
            {"metric": "load", "below": 7.0, "probability": "95 %"},
        ],
        "runs": 200,
    }
    content |= changes
    path = folder / "dive.yaml"
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))
    return path


def shown_text(page):
    """Return the text of a page without its scripts."""
    return re.sub(r"(?s)<(script|style|noscript).*?</\1>|<[^>]*>", " ", page.read_text("utf-8"))


# Flight whose drag slows it down, with an oscillation of the angle of attack
GLIDE = """
import math

def fly(inputs, settings):
    time = [0.5 * k for k in range(61)]
    drag, lift, wind = (inputs[name] for name in ("drag", "lift", "wind"))
    speed = [1.0 / (1.0 / 300.0 + 0.5e-5 * drag * t) for t in time]
    alpha = [wind + 5.0 / lift * (1.0 + 0.3 * math.exp(-0.1 * t) * math.cos(0.8 * t)) for t in time]
    return {"total": speed[-1], "history": {"time": time, "speed": speed, "alpha": alpha}}
"""


def glide_campaign(folder, **changes):
    """Write a campaign with the simulator ``GLIDE`` and declared measurement errors."""
    spread = {"distribution": "normal", "sigma": "5 %"}
    wind = {"distribution": "normal", "sigma": "0.2 m/s", "varies_by": "flight"}
    entries: dict[str, Any] = {
        "inputs": {name: {"unit": "-", "nominal": 1} for name in ("drag", "lift")}
        | {"wind": {"unit": "m/s", "nominal": 0}},
        "dispersions": {"drag": spread, "lift": spread, "wind": wind},
        "histories": {"speed": {"unit": "m/s"}, "alpha": {"unit": "deg"}},
        "measured": {"speed": 1.0, "alpha": 0.1},
        "requirements": [],
    }
    return write_study(folder, GLIDE, **entries | changes)


def write_glide(folder, flights, ripple=0.0):
    """Write records of flights with (drag, lift, vehicle, clock offset); return their table.

    Four samples of the speed are missing in each record.
    """
    draw, lines = np.random.default_rng(1), ["history,vehicle"]
    space: dict[str, Any] = {}
    exec(GLIDE, space)  # noqa: S102
    for k, (drag, lift, vehicle, offset) in enumerate(flights):
        inputs = {"drag": drag, "lift": lift, "wind": 0.2 * draw.standard_normal()}
        columns = {
            key: np.array(values) for key, values in space["fly"](inputs, {})["history"].items()
        }
        columns["alpha"] += 0.1 * draw.standard_normal(61) + ripple * np.sin(columns["time"])
        columns["speed"] += draw.standard_normal(61)
        columns["speed"][10:14] = np.nan
        columns["time"] += offset
        table = np.column_stack([*columns.values()])
        heads = ",".join(columns)
        np.savetxt(folder / f"{k}.csv", table, delimiter=",", header=heads, comments="")
        lines.append(f"{k}.csv,{vehicle}")
    path = folder / "flights.csv"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path
