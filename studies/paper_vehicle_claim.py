"""Assessment of a member of the ensemble with the printed gains: margins, flights and the claim.

Flights use the plans of abhv-mc with the paper's dispersions. A law is better in a flight if its
rms error is smaller, over the whole flight or without each ramp of the bank and 5 s after it.
"""

from typing import Any

import numpy as np
from experiment import Floats, random_parameters
from numpy.typing import NDArray
from paper_vehicle_envelope import measure_envelope
from paper_vehicle_flights import AXES, CONTROLLERS, LAWS, PERIOD, RECORDED, SHOWN, look_together
from paper_vehicle_sides import find_trim, measure

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.control.design.profile import ramp_times
from abhv_mc_vehicle.control.design.reference import SETTLING
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.kernel.plant.actuator_step import HIGH
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.stability.analysis import margins_of_flights
from abhv_mc_vehicle.stability.steady import make_steady_plan

ERRORS = {  # angle of the paper's claim -> channel and its command
    "angle_of_attack": ("angle_of_attack_deg", "angle_of_attack_command_deg"),
    "sideslip": ("sideslip_deg", None),
    "bank": ("bank_deg", "bank_command_deg"),
}
SURFACES = ("aileron", "rudder", "elevator")
Flown = dict[str, Floats]  # [flight, time] by channel


def margins_of(vehicle: Vehicle, mission: Mission, law: str) -> dict[str, Any]:
    """Return the smallest margins of all loops in level flight, or the reason for their absence."""
    steady = make_steady_plan(vehicle, mission, CONTROLLERS[law], law)
    margins = margins_of_flights(steady, steady, nominal_parameters(), ("trim",))
    least = dict(
        zip(("gain_db", "phase_deg", "delay_ms", "disk"), margins.table[0].tolist(), strict=True)
    )
    return {"fault": margins.faults[0][0]} | least


def fly_law(
    vehicle: Vehicle, mission: Mission, law: str, flights: int
) -> tuple[Flown, NDArray[np.bool_]]:
    """Run the nominal flight and then dispersed ones; return histories, and which are complete."""
    plan = make_plan(vehicle, mission, CONTROLLERS[law], law)
    parameters = np.concatenate([nominal_parameters(), random_parameters(flights)])
    block = fly(plan, parameters, RECORDED)
    history = block.history.astype(np.float64)
    return {name: history[:, :, i] for i, name in enumerate(SHOWN)}, block.outcome == Outcome.OK


def settled_samples(mission: Mission, times: Floats) -> NDArray[np.bool_]:
    """Return the mask of times outside each ramp and SETTLING after it."""
    is_settled = np.ones(times.size, dtype=bool)
    for first, last in ramp_times(mission):
        is_settled &= (times < first - 1e-9) | (times >= last + SETTLING - 1e-9)
    return is_settled


def rms(values: Floats) -> Floats:
    """Return the root mean square over time [flight]."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))


def traits_of(vehicle: Vehicle) -> dict[str, dict[str, float]]:
    """Return the traits of the vehicle's class and of its box."""
    traits = {"class": measure(vehicle, *find_trim(vehicle)), "box": measure_envelope(vehicle)}
    return {
        name: {trait: float(f"{value:.4g}") for trait, value in values.items()}
        for name, values in traits.items()
    }


def judge(vehicle: Vehicle, mission: Mission, flights: int) -> dict[str, Any]:
    """Return the assessment of one vehicle with its S."""
    flown, completed = {}, np.ones(flights + 1, dtype=bool)
    result: dict[str, Any] = {
        "traits": traits_of(vehicle),
        "margins": {},
        "lost": {},
        "saturated": {},
        "ends": [],
    }
    for law in LAWS:
        result["margins"][law] = margins_of(vehicle, mission, law)
        flown[law], ok = fly_law(vehicle, mission, law, flights)
        result["lost"][law] = int((~ok).sum())
        completed &= ok
        deflections = np.stack([flown[law][f"{surface}_deg"][0] for surface in SURFACES])
        limits = np.rad2deg(vehicle.actuators[:3, HIGH])[:, None]
        result["saturated"][law] = bool((np.abs(deflections) >= limits - 1e-6).any())
    nominal = {law: {name: values[0] for name, values in flown[law].items()} for law in LAWS}
    for axis in AXES:
        seen = look_together(axis, nominal)
        window = slice(round(axis.window[0] / PERIOD), round(axis.window[1] / PERIOD) + 1)
        dispersed = {}  # lowest and highest of all flights, in our signs
        for law in axis.laws:
            values_of_channel = flown[law][axis.channels[0]][completed][:, window]
            dispersed[law] = [
                round(float(values_of_channel.min()), 4),
                round(float(values_of_channel.max()), 4),
            ]
        ends = {
            "low": round(seen.low, 4),
            "high": round(seen.high, 4),
            "misses": [round(m, 4) for m in seen.misses],
        }
        result["ends"].append(
            {"figure": axis.figure, "axis": axis.label, "mirrored": seen.mirrored}
            | ends
            | {"dispersed": dispersed}
        )
    result["claim"], result["use"] = compare(flown, completed, mission)
    return result


def compare(
    flown: dict[str, Flown], completed: NDArray[np.bool_], mission: Mission
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return errors by window and angle, and control effort by surface, of dispersed flights."""
    claim, used = {}, {}
    times = np.arange(flown["tlc"]["bank_deg"].shape[1]) * PERIOD
    windows = {"whole": np.ones(times.size, dtype=bool), "settled": settled_samples(mission, times)}
    dispersed_rows = completed.copy()
    dispersed_rows[0] = False
    for window_name, inside in windows.items():
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
                law: float(np.median(errors)) for law, errors in zip(LAWS, both, strict=True)
            }
        claim[window_name] = counts
    for surface in SURFACES:
        uses = (flown[law][f"{surface}_deg"][dispersed_rows] for law in LAWS)
        used[surface] = {
            law: float(np.median(rms(use - use[:, :1])))
            for law, use in zip(LAWS, uses, strict=True)
        }
    return claim, used
