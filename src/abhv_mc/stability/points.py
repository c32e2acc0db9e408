"""Where flights are linearised: the trim of the true plant, or the flight at a time."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.control import columns as ref
from abhv_mc.control.controller_file import Controller
from abhv_mc.control.design.guidance_trim import GuidancePoints, GuidanceTrim, trim_along
from abhv_mc.control.design.reference import make_mission_trim_tables
from abhv_mc.control.mission import Level, Mission
from abhv_mc.flight.fly import fly
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.prepare import OwnParts, make_gains, make_plan
from abhv_mc.flight.user_law import PYTHON
from abhv_mc.io.input_error import InputError
from abhv_mc.plant import state as s
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.stability import path_coordinates as path
from abhv_mc.stability.linearize import Points, law_slopes, memory_count, plant_slopes
from abhv_mc.stability.probe import law_memory_rows, law_tick, replay_law, undisturbed
from abhv_mc.user_code.design import DesignModel
from abhv_mc.vehicle.arrays import Floats
from abhv_mc.vehicle.model import Vehicle

_ITERATIONS = 25
_AT_REST = 1e-12  # what the law's memory at a trim may change by in a tick
_RESTING = 1e5  # how much more that counts than the controls, where not both can be met
_BALANCED = 1e-9  # rad/s2 and so on: what a trim may leave of any rate
_TRIM_UNKNOWNS = (path.ALPHA, path.BANK, path.P, path.Q, path.R, 10, 11, 12, 13)
_TRIM_RATES = tuple(range(1, 10))  # all but the altitude's
_LARGEST = np.array([0.05, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.3])  # a Newton step of the unknowns


class Found(NamedTuple):
    """Points, and what is wrong with each of them (empty where nothing is)."""

    points: Points
    faults: list[str]


def make_steady_plan(
    vehicle: Vehicle,
    mission: Mission,
    controller: Controller,
    name: str,
    bank: float = 0.0,
    own: OwnParts | None = None,
) -> FlightPlan:
    """A plan whose reference is steady flight at the mission's start for all time, with the gains that belong to it.

    ``bank`` (rad) is the guidance trim's in a steady turn; 0 asks for straight flight, whatever bank that takes.
    ``own`` is the law of a controller of the user's own. Raises InputError where no steady turn has that bank.
    """
    level = mission.model_copy(update={"manoeuvre": Level(kind="level"), "duration": 2.0 / controller.rate})
    plan = make_plan(vehicle, level, controller, name, own=own)
    trim_tables = make_mission_trim_tables(mission, vehicle)
    row = plan.reference[0].copy()
    heading_rate = _turn_of_bank(vehicle, plan, row, bank) if bank else 0.0
    nominal = _trim_turn(vehicle, plan, row, heading_rate)
    row[ref.HEADING_RATE] = heading_rate
    row[ref.ANGLE_OF_ATTACK], row[ref.BANK] = nominal.angle_of_attack[0], nominal.bank[0]
    row[ref.EQUIVALENCE_RATIO], row[ref.ELEVATOR] = nominal.equivalence_ratio[0], nominal.elevator[0]
    reference = np.tile(row, (3, 1))
    reference[:, ref.TIME] = plan.reference[:3, ref.TIME]
    _, gains = make_gains(controller, own, DesignModel(vehicle, level, reference, trim_tables))
    return replace(plan, reference=reference, gains=gains, trim_tables=trim_tables)


def _trim_turn(vehicle: Vehicle, plan: FlightPlan, row: Floats, heading_rate: float) -> GuidanceTrim:
    one = np.ones(1)
    points = GuidancePoints(
        row[ref.SPEED] * one,
        row[ref.DENSITY] * one,
        row[ref.SOUND_SPEED] * one,
        row[ref.GRAVITY] * one,
        row[ref.RADIUS] * one,
        row[ref.LATITUDE] * one,
        0.0 * one,
        row[ref.HEADING] * one,
        0.0 * one,
        0.0 * one,
        row[ref.SPEED] * heading_rate * one,
    )
    return trim_along(vehicle, plan.trim_tables, points, vehicle.constants.mass_start, plan.timing.tick)


def _turn_of_bank(vehicle: Vehicle, plan: FlightPlan, row: Floats, bank: float) -> float:
    """Heading rate of the steady turn whose guidance trim has the bank, rad/s."""
    from scipy.optimize import brentq

    def off(heading_rate: float) -> float:
        return float(_trim_turn(vehicle, plan, row, heading_rate).bank[0] - bank)

    guess = float(row[ref.GRAVITY] / row[ref.SPEED] * np.tan(bank))
    ends = sorted((0.2 * guess, 2.0 * guess))
    if off(ends[0]) * off(ends[1]) > 0.0:
        wanted = "a bank at which this vehicle can turn steadily"
        raise InputError("--bank", None, None, f"{np.rad2deg(bank):g} deg", wanted)
    return float(brentq(off, *ends, xtol=1e-14))


def trim_points(plan: FlightPlan, parameters: Floats) -> Found:
    """The true plants' trims under a plan of :func:`make_steady_plan`, in air at rest: ``parameters`` [flight, ...].

    Altitude, speed and heading are the reference's, flight path angle and sideslip zero; all else is such that nothing
    but the heading changes. The law is at rest there: errors zero, integrals whatever holds the trim.
    """
    calm = undisturbed(parameters)
    count, row = len(calm), plan.reference[0]
    at = np.zeros((count, 14))
    at[:, path.ALTITUDE], at[:, path.SPEED], at[:, path.CHI] = row[ref.ALTITUDE], row[ref.SPEED], row[ref.HEADING]
    at[:, path.ALPHA], at[:, path.BANK] = row[ref.ANGLE_OF_ATTACK], row[ref.BANK]
    at[:, 12:] = row[ref.ELEVATOR], row[ref.EQUIVALENCE_RATIO]
    mass = plan.initial_state[s.MASS] * calm[:, PARAMETER_INDEX["mass.total"]]
    latitude = np.full(count, plan.initial_state[s.LATITUDE])
    nothing = np.empty((count, 0))
    fixed = Points(at[:, :10], at[:, 10:], latitude, mass, nothing, nothing, 0)
    unknown, wanted = list(_TRIM_UNKNOWNS), list(_TRIM_RATES)
    for _ in range(_ITERATIONS):
        found = plant_slopes(plan, calm, at[:, :10], at[:, 10:], fixed)
        left = found.value[:, wanted].copy()
        left[:, wanted.index(path.CHI)] -= row[ref.HEADING_RATE]
        if np.abs(left).max() < 0.01 * _BALANCED:
            break
        J = found.slope[:, wanted][:, :, unknown]
        at[:, unknown] -= np.clip(np.linalg.solve(J, left[..., None])[..., 0], -_LARGEST, _LARGEST)
    limit = plan.vehicle.constants.surface_limit * calm[:, PARAMETER_INDEX["actuator.deflection_limit"]]
    eta_max = plan.vehicle.constants.equivalence_ratio_max * calm[:, PARAMETER_INDEX["engine.equivalence_ratio_limit"]]
    eta_min = plan.vehicle.constants.equivalence_ratio_min
    deflected = np.asarray((np.abs(at[:, 10:13]) > limit[:, None]).any(axis=1))
    beyond = deflected | (at[:, 13] > eta_max) | (at[:, 13] < eta_min)
    off = np.asarray(~(np.abs(left).max(axis=1) < _BALANCED))
    faults = [
        "no trim was found" if o else "the trim is beyond the limits of surfaces or engine" if b else ""
        for o, b in zip(off.tolist(), beyond.tolist(), strict=True)
    ]
    points = fixed._replace(path=at[:, :10], controls=at[:, 10:], measured=at[:, :10])
    return Found(points._replace(memory=_memory_at_rest(plan, points)), faults)


def _memory_at_rest(plan: FlightPlan, points: Points) -> Floats:
    """The law's memory [point, memory] that stays as it is and whose commands are the points' controls.

    Where no memory does both, as of a law without integrals, it stays as it is and comes closest to the controls.
    """
    count = memory_count(plan)
    memory = np.zeros((len(points.path), count))
    last = [s.CMD <= row < s.CMD + 4 for row in law_memory_rows(plan).values()]
    memory[:, last] = points.controls[:, : sum(last)]
    for _ in range(8 if count else 0):
        law = law_slopes(plan, points._replace(memory=memory))
        left = law.value - np.hstack([memory, points.controls])
        if np.abs(left).max() < _AT_REST:
            break
        J = law.slope[:, :, 10:].copy()
        J[:, :count] -= np.eye(count)
        left[:, :count] *= _RESTING
        J[:, :count] *= _RESTING
        known = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)  # a law of the user's own may fail
        memory[known] -= np.einsum("pij,pj->pi", np.linalg.pinv(J[known], rcond=1e-13), left[known])
    return memory


def flown_points(plan: FlightPlan, parameters: Floats, time: float) -> Found:
    """The flights of ``parameters`` [flight, parameter] at the control tick nearest to ``time`` (s).

    The law's memory is as flown. A flight that has ended has its last state, and a fault that says so, as has one of
    which a command stands at a limit.
    """
    tick = min(round(time / plan.timing.tick), plan.timing.ticks)
    shorter = replace(plan, timing=plan.timing._replace(ticks=tick))
    block = fly(shorter, parameters, record_every=1, keep_states=True)
    states = block.states
    ended = np.asarray(~np.isfinite(states[:, tick]).all(axis=1))
    held = states.copy()
    held[ended] = np.broadcast_to(states[ended, :1], held[ended].shape)  # numbers, of which nothing is said
    measured, memory = replay_law(plan, parameters, held, tick)
    now = held[:, tick]
    points = Points(
        path.make_path(now),
        np.ascontiguousarray(now[:, path.CONTROLS]),
        now[:, s.LATITUDE],
        now[:, s.MASS],
        measured,
        memory,
        tick,
    )
    limited = behind_limit(plan, points)
    faults = [
        f"the flight has ended before {time:g} s" if e else "a command stands at a limit" if b else ""
        for e, b in zip(ended.tolist(), limited.tolist(), strict=True)
    ]
    return Found(points, faults)


def behind_limit(plan: FlightPlan, points: Points) -> NDArray[np.bool_]:
    """Whether the law, left free, commands what it or the vehicle's record does not allow, [point]."""
    free = law_tick(plan, points.tick, points.measured, points.memory)
    c = plan.vehicle.constants
    eta = free.command[:, 3]
    beyond = np.asarray((eta < c.equivalence_ratio_min) | (eta > c.equivalence_ratio_max))
    beyond |= (np.abs(free.command[:, :3]) > c.surface_limit).any(axis=1)
    if plan.law == PYTHON:  # its limits of the angle of attack and the bank are in its code
        return beyond
    low, high, bank = plan.settings[-3:]
    alpha, sigma = free.guidance[:, 1], np.abs(free.guidance[:, 2])
    return np.asarray(beyond | (alpha < low) | (alpha > high) | (sigma > bank))
