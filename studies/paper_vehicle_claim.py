"""What a member of the ensemble says: margins, dispersed flights and the paper's claim, with the printed gains.

Flown by the product's own plans under the paper's dispersions. A law is closer in a flight where its rms error is
smaller; counted over the whole flight, and without each ramp of the bank and 5 s after it.
"""

from typing import Any

import numpy as np
from experiment import Floats, random_parameters
from numpy.typing import NDArray
from paper_vehicle_box import make_mission, make_vehicle
from paper_vehicle_flights import AXES, CONTROLLERS, LAWS, PERIOD, RECORDED, SHOWN, look_together

from abhv_mc.control.design.profile import ramp_times
from abhv_mc.control.design.reference import SETTLING
from abhv_mc.control.mission import Mission
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import make_plan
from abhv_mc.kernel.plant.vehicle import Vehicle
from abhv_mc.stability.analysis import margins_of_flights
from abhv_mc.stability.steady import make_steady_plan

ERRORS = {  # what the paper's claim names: a channel and its command
    "angle_of_attack": ("angle_of_attack_deg", "angle_of_attack_command_deg"),
    "sideslip": ("sideslip_deg", None),
    "bank": ("bank_deg", "bank_command_deg"),
}
SURFACES = ("aileron", "rudder", "elevator")
Flown = dict[str, Floats]  # [flight, time] by channel


def margins_of(vehicle: Vehicle, mission: Mission, law: str) -> dict[str, Any]:
    """In level flight, the least over all loops; what keeps the law from having any."""
    steady = make_steady_plan(vehicle, mission, CONTROLLERS[law], law)
    found = margins_of_flights(steady, steady, nominal_parameters(), ("trim",))
    least = dict(
        zip(("gain_db", "phase_deg", "delay_ms", "disk"), found.table[0].tolist(), strict=True)
    )
    return {"fault": found.faults[0][0]} | least


def fly_law(
    vehicle: Vehicle, mission: Mission, law: str, flights: int
) -> tuple[Flown, NDArray[np.bool_]]:
    """The nominal flight first, then the dispersed ones; and which of them fly to the end."""
    plan = make_plan(vehicle, mission, CONTROLLERS[law], law)
    parameters = np.concatenate([nominal_parameters(), random_parameters(flights)])
    block = fly(plan, parameters, RECORDED)
    history = block.history.astype(np.float64)
    return {name: history[:, :, i] for i, name in enumerate(SHOWN)}, block.outcome == Outcome.OK


def settled_samples(mission: Mission, times: Floats) -> NDArray[np.bool_]:
    """Without each ramp and SETTLING after it."""
    kept = np.ones(times.size, dtype=bool)
    for first, last in ramp_times(mission):
        kept &= (times < first - 1e-9) | (times >= last + SETTLING - 1e-9)
    return kept


def rms(values: Floats) -> Floats:
    """Over time, [flight]."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))


def judge(values: dict[str, float], flights: int) -> dict[str, Any]:
    """All that is said of one member."""
    vehicle, mission = make_vehicle(values), make_mission(values)
    flown, kept = {}, np.ones(flights + 1, dtype=bool)
    result: dict[str, Any] = {
        "margins": {},
        "lost": {},
        "saturated": {},
        "ends": [],
        "claim": {},
        "use": {},
    }
    for law in LAWS:
        result["margins"][law] = margins_of(vehicle, mission, law)
        flown[law], ok = fly_law(vehicle, mission, law, flights)
        result["lost"][law] = int((~ok).sum())
        kept &= ok
        largest = max(float(np.abs(flown[law][f"{surface}_deg"][0]).max()) for surface in SURFACES)
        result["saturated"][law] = bool(
            largest >= np.rad2deg(vehicle.constants.surface_limit) - 1e-6
        )
    nominal = {law: {name: values[0] for name, values in flown[law].items()} for law in LAWS}
    for axis in AXES:
        seen = look_together(axis, nominal)
        window = slice(round(axis.window[0] / PERIOD), round(axis.window[1] / PERIOD) + 1)
        dispersed = {}  # lowest and highest of all flights, in our signs
        for law in axis.laws:
            shown = flown[law][axis.channels[0]][kept][:, window]
            dispersed[law] = [round(float(shown.min()), 4), round(float(shown.max()), 4)]
        ends = {
            "low": round(seen.low, 4),
            "high": round(seen.high, 4),
            "misses": [round(m, 4) for m in seen.misses],
        }
        result["ends"].append(
            {"figure": axis.figure, "axis": axis.words, "mirrored": seen.mirrored}
            | ends
            | {"dispersed": dispersed}
        )
    times = np.arange(nominal["tlc"]["bank_deg"].size) * PERIOD
    windows = {"whole": np.ones(times.size, dtype=bool), "settled": settled_samples(mission, times)}
    dispersed_rows = kept.copy()
    dispersed_rows[0] = False
    for words, inside in windows.items():
        counts = {}
        for name, (channel, command) in ERRORS.items():
            both = [
                rms(
                    (flown[law][channel] - (flown[law][command] if command else 0.0))[
                        dispersed_rows
                    ][:, inside]
                )
                for law in LAWS
            ]
            closer = 100.0 * float(np.mean(both[0] < both[1]))
            counts[name] = {"closer_percent": closer} | {
                law: float(np.median(each)) for law, each in zip(LAWS, both, strict=True)
            }
        result["claim"][words] = counts
    for surface in SURFACES:
        uses = (flown[law][f"{surface}_deg"][dispersed_rows] for law in LAWS)
        result["use"][surface] = {
            law: float(np.median(rms(use - use[:, :1])))
            for law, use in zip(LAWS, uses, strict=True)
        }
    return result
