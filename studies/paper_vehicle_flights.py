"""Fast nominal flights of a candidate, and their distance from the ends of Figures 3 to 11.

To save time, both laws share trim tables over the angles of attack of the S, air and Earth are
computed at five latitudes, gains have fewer knots, and one lane is used.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from experiment import ROOT, Floats
from paper_vehicle_box import BASE, BASE_MISSION, make_mission, make_vehicle
from paper_vehicle_sides import excesses, measure

from abhv_mc.flights.blocks import Recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.control.controller_file import LqrController, TlcController, read_controller
from abhv_mc_vehicle.control.design.design_model import (
    guidance_rates,
    make_environment,
    make_environment_points,
)
from abhv_mc_vehicle.control.design.lqr_design import Nominal, attitude_model_rates
from abhv_mc_vehicle.control.design.profile import make_profile, ramp_times
from abhv_mc_vehicle.control.design.reference import trim_along
from abhv_mc_vehicle.control.design.tlc_design import make_tlc_gains
from abhv_mc_vehicle.control.design.trim_tables import make_trim_tables
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import make_initial_state, make_plan
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.trim_lookup import GuidancePoints
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.plant.effectiveness import make_effectiveness
from abhv_mc_vehicle.plant.trim import TrimPoint
from abhv_mc_vehicle.vehicle.vehicle_code import make_variables, table_rows

LAWS = ("tlc", "lqr")
READING = 0.02  # of an axis, up to which an end counts as inside in a search
FURTHEST = 0.20  # of an axis, largest miss of a member
TICK, TICKS = 0.01, 6000
OFF_NODE_AIM = 0.12  # deg
RELIEVED, RELIEF = 2, 0.12  # number of ends that may be outside, and the share of the axis
INNER_SIDES = 0.02  # distance from the ends of a side in a search, in its unit
_INNER = 0.12  # of an interval's length, at each end
_UNKNOWN = 2.0  # of an axis, unknown miss and upper limit of misses
ANGLES = np.deg2rad(-2.0), np.deg2rad(12.0)  # of attack, of the trim tables
NODES = np.arange(-3.0, 21.1, 3.0)  # deg, of GHAME's tables
PERIOD = 2 * TICK  # s, of recorded samples
_STILL = BASE_MISSION.make_earth()._replace(rotation_rate=0.0)
_LATITUDES = np.deg2rad(np.linspace(29.2, 29.4, 5))
_PLACES = make_environment_points(_STILL, np.full(5, 20e3), _LATITUDES)
_AROUND = make_environment(_STILL, 20e3, BASE_MISSION.start.latitude)
CONTROLLERS = {law: read_controller(ROOT / f"configs/control/{law}.yaml") for law in LAWS}
SHOWN = (
    "heading_deg",
    "angle_of_attack_deg",
    "angle_of_attack_command_deg",
    "sideslip_deg",
    "bank_deg",
    "bank_command_deg",
    "aileron_deg",
    "rudder_deg",
    "elevator_deg",
    "equivalence_ratio_command",
    "altitude_m",
    "speed_mps",
    "latitude_deg",
    "longitude_deg",
)
RECORDED = Recording(round(PERIOD / TICK), tuple(CHANNEL_INDEX[name] for name in SHOWN))


@dataclass(frozen=True)
class Axis:
    """Axis of a figure, whose ends are within a tick of the data and thus give their range."""

    figure: int
    label: str
    channels: tuple[str, ...]  # drawn in it, without the unit
    lowest: tuple[float, float]
    highest: tuple[float, float]
    width: float
    laws: tuple[str, ...] = LAWS
    mirror: bool = False  # whether the fit may change the sign, which the paper does not define
    counts: bool = True  # whether its ends are among the 20; otherwise they are limits
    window: tuple[float, float] = (0.0, 60.0)  # s


def _alike(
    figure: int, label: str, channels: tuple[str, ...], low: float, high: float, tick: float
) -> list[Axis]:
    return [
        Axis(
            figure,
            f"{label}, {law.upper()}",
            channels,
            (low, low + tick),
            (high - tick, high),
            high - low,
            (law,),
        )
        for law in LAWS
    ]


_BANK = ("bank_deg", "bank_command_deg")
AXES = (
    Axis(
        3,
        "altitude (m)",
        ("altitude_m",),
        (19950.0, 20050.0),
        (19950.0, 20050.0),
        100.0,
        counts=False,
    ),
    Axis(3, "speed (m/s)", ("speed_mps",), (1395.0, 1405.0), (1395.0, 1405.0), 10.0, counts=False),
    # The axis extends one tick beyond the 90 deg of the start.
    Axis(4, "heading (deg)", ("heading_deg",), (84.0, 85.0), (90.02, 91.0), 7.0),
    *_alike(
        5,
        "angle of attack (deg)",
        ("angle_of_attack_deg", "angle_of_attack_command_deg"),
        2.0,
        6.0,
        1.0,
    ),
    Axis(6, "sideslip (deg)", ("sideslip_deg",), (-0.2, -0.1), (0.6, 0.7), 0.9, mirror=True),
    # An axis of -50 .. 100, and an inset from 2 s to 8 s with a more precise upper end.
    Axis(7, "bank (deg), TLC", _BANK, (-50.0, 0.0), (50.0, 55.0), 150.0, ("tlc",)),
    Axis(7, "bank (deg), LQR", _BANK, (-50.0, 0.0), (50.0, 60.0), 150.0, ("lqr",)),
    Axis(
        7,
        "inset (deg), TLC",
        _BANK,
        (40.0, 45.0),
        (40.0, 55.0),
        15.0,
        ("tlc",),
        False,
        False,
        (2.0, 8.0),
    ),
    Axis(
        7,
        "inset (deg), LQR",
        _BANK,
        (40.0, 50.0),
        (40.0, 60.0),
        20.0,
        ("lqr",),
        False,
        False,
        (2.0, 8.0),
    ),
    Axis(8, "aileron (deg)", ("aileron_deg",), (-1.2, -1.0), (0.6, 0.8), 2.0, mirror=True),
    Axis(9, "rudder (deg)", ("rudder_deg",), (-0.4, -0.3), (0.2, 0.3), 0.7, mirror=True),
    Axis(10, "elevator (deg)", ("elevator_deg",), (-0.5, 0.0), (2.0, 2.5), 3.0, mirror=True),
    Axis(11, "equivalence ratio", ("equivalence_ratio_command",), (0.8, 0.85), (1.2, 1.25), 0.45),
)


# Maximum of the bank (deg) in the insets of Figure 7, if their axes are automatic: between the last
# ticks of 40, 45, 50, 55 (TLC) and 40, 50, 60 (LQR).
INSETS = {"inset (deg), TLC": (50.0, 55.0), "inset (deg), LQR": (50.0, 60.0)}


def strict_ends(ends: list[dict[str, Any]]) -> int:
    """Return the number of the 20 ends that are in their intervals, without tolerance."""
    return sum(
        miss == 0.0
        for axis, end in zip(AXES, ends, strict=True)
        if axis.counts
        for miss in _misses(axis, end["low"], end["high"])
    )


def in_insets(ends: list[dict[str, Any]]) -> bool:
    """Return whether the bank is in both insets, without tolerance."""
    return all(
        max(_misses(axis, end["low"], end["high"])) == 0.0
        and INSETS[axis.label][0] <= end["high"] <= INSETS[axis.label][1]
        for axis, end in zip(AXES, ends, strict=True)
        if axis.label in INSETS
    )


@dataclass(frozen=True)
class Seen:
    """Range of a candidate on one axis; misses are shares of the width of the axis."""

    axis: Axis
    low: float
    high: float
    mirrored: bool
    misses: tuple[float, float]
    aside: tuple[float, float]  # signed misses of the inner parts of the intervals


@dataclass(frozen=True)
class Candidate:
    """Comparison of a candidate's flights with the axes."""

    seen: tuple[Seen, ...] = ()  # empty if a flight terminates early
    expected: tuple[Seen | None, ...] = ()  # from nominal controls, if no flight is simulated
    traits: tuple[float, ...] = ()  # in the order of TRAITS
    off_node: float = 0.0  # deg, the trim's distance from a node of the tables
    cycle: float = 0.0  # oscillation of the surfaces at the end, deg per sample
    class_traits: dict[str, float] = field(default_factory=dict)  # of SIDES

    @property
    def keeps_sides(self) -> bool:
        """True if each trait is within its sides."""
        return bool(self.class_traits) and not excesses(self.class_traits).any()

    @property
    def ends_in(self) -> int:
        """Number of the 20 ends that are in their intervals."""
        return sum(
            miss <= READING
            for axis_result in self.seen
            if axis_result.axis.counts
            for miss in axis_result.misses
        )

    @property
    def worst(self) -> float:
        """Largest miss, including limits."""
        return max(
            (miss for axis_result in self.seen for miss in axis_result.misses), default=np.inf
        )

    def residuals(self, left_out: int = 0, *, relieved: bool = False) -> Floats:
        """Return the residuals of a search: misses of the intervals' inner parts, over the axes.

        With `relieved` the two largest misses are reduced by RELIEF.
        """
        residuals: list[float] = []
        for axis, axis_result in zip(
            AXES, self.seen or self.expected or (None,) * len(AXES), strict=True
        ):
            is_included = axis.figure != left_out
            residuals += (
                [_UNKNOWN, _UNKNOWN]
                if axis_result is None
                else [
                    is_included * float(np.clip(x, -_UNKNOWN, _UNKNOWN)) for x in axis_result.aside
                ]
            )
        if relieved:
            counted = np.repeat([axis.counts for axis in AXES], 2)
            for i in np.argsort(np.where(counted, np.abs(residuals), 0.0))[-RELIEVED:]:
                residuals[i] = float(np.sign(residuals[i])) * max(abs(residuals[i]) - RELIEF, 0.0)
        return np.array(
            [
                *residuals,
                2.0 * max(OFF_NODE_AIM - self.off_node, 0.0),
                min(self.cycle, 1.0),
                *excesses(self.class_traits, INNER_SIDES),
            ]
        )


TRAITS = {
    "aileron": "roll per aileron, 1/s2",
    "rudder": "yaw per rudder, 1/s2",
    "elevator": "pitch per elevator, 1/s2",
    "sideslip": "yaw per sideslip, 1/s2",
    "angle_of_attack": "pitch per angle of attack, 1/s2",
    "rates": "pitch damping, 1/s",
    "lift_slope": "trimmed lift per angle of attack over the S, 1/rad",
    "drag_slope": "trimmed drag per angle of attack over the S, 1/rad",
}


def make_quick_trim_tables(vehicle: Vehicle) -> Tables:
    """Return trim tables over the angles of attack that the S needs."""
    low, high = ANGLES
    constants = vehicle.constants._replace(angle_of_attack_min=low, angle_of_attack_max=high)
    return make_trim_tables(vehicle._replace(constants=constants), 20e3, (1400.0, 1400.0))


def make_quick_reference(
    vehicle: Vehicle, mission: Mission, trim_tables: Tables
) -> tuple[Floats, bool]:
    """Return the reference of `solve_reference` for constant altitude and speed.

    Also return whether all of it is trimmed.
    """
    times: Floats = np.arange(TICKS + 1, dtype=np.float64) * TICK
    profile = make_profile(mission, times)
    north_speed, east_speed = (
        profile.speed * np.cos(profile.heading),
        profile.speed * np.sin(profile.heading),
    )
    north, east = (
        TICK * np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]))])
        for v in (north_speed, east_speed)
    )
    latitude = mission.start.latitude + north / _PLACES.radius[2]
    conditions = {
        name: np.interp(latitude, _LATITUDES, value) for name, value in _PLACES._asdict().items()
    }
    nothing = np.zeros_like(times)
    points = GuidancePoints(
        profile.speed,
        *(conditions[name] for name in ("density", "sound_speed", "gravity", "radius")),
        latitude,
        nothing,
        profile.heading,
        nothing,
        nothing,
        profile.speed * profile.heading_rate,
    )
    nominal = trim_along(vehicle, trim_tables, points, vehicle.constants.mass_start, TICK)
    column = {
        "time": times,
        **{name: value for name, value in profile._asdict().items() if name in REFERENCE},
        **{name: value for name, value in nominal._asdict().items() if name in REFERENCE},
        "north": north,
        "east": east,
        "latitude": latitude,
        "settled": np.ones_like(times),
        "track_north": np.full_like(times, np.sin(mission.start.heading)),
        "track_east": np.full_like(times, -np.cos(mission.start.heading)),
        **conditions,
    }
    reference = np.ascontiguousarray(np.stack([column[name] for name in REFERENCE], axis=1))
    return reference, not nominal.status.any()


def _nominal(rows: Floats) -> Nominal:
    """Return the nominal values of rows of the reference as columns ``[row, 1]``."""
    columns = (rows[:, REFERENCE.index(name)][:, None] for name in Nominal._fields[1:])
    return Nominal(_AROUND, *columns)  # type: ignore[arg-type]


def _slopes(function: Callable[[Any], Any], points: Floats) -> Floats:
    """Return Jacobians [row, output, input] at ``points`` [row, input] by complex steps."""
    x = points.T[:, :, None] + 1e-30j * np.eye(points.shape[1])[:, None, :]
    return np.moveaxis(np.imag(function(x)) / 1e-30, 1, 0)


def _attitude_slopes(vehicle: Vehicle, rows: Floats) -> Floats:
    """Return Jacobians [row, 6, 9] of the rates of (alpha, beta, bank, p, q, r).

    The inputs are these states and (aileron, rudder, elevator).
    """
    n = _nominal(rows)
    nothing = 0.0 * n.bank
    columns = (n.angle_of_attack, nothing, n.bank, *n.turn_rates(), nothing, nothing, n.elevator)
    return _slopes(lambda x: attitude_model_rates(vehicle, n, x), np.concatenate(columns, axis=1))


def _regulators(A: Floats, B: Floats, weights: Any, unit: float) -> Floats:
    """Return gains [row, input, state] from the stable subspaces of the Hamiltonian matrices."""
    Q, R = (
        np.diag(np.array([w for _, w in group], dtype=np.float64))
        for group in (weights.states, weights.inputs)
    )
    B = unit * B
    to_costates = np.linalg.solve(R, np.swapaxes(B, 1, 2))
    H = np.concatenate(
        [
            np.concatenate([A, -B @ to_costates], axis=2),
            np.concatenate([np.broadcast_to(-Q, A.shape), -np.swapaxes(A, 1, 2)], axis=2),
        ],
        axis=1,
    )
    values, vectors = np.linalg.eig(H)
    states = A.shape[1]
    order = np.argsort(values.real, axis=1)[:, :states]
    if (np.take_along_axis(values.real, order, axis=1) >= 0.0).any():
        raise np.linalg.LinAlgError("no stabilising solution")
    stable = np.take_along_axis(vectors, order[:, None, :], axis=2)
    X = np.real(stable[:, states:] @ np.linalg.inv(stable[:, :states]))
    return np.asarray(unit * to_costates @ X)


def make_quick_lqr_gains(
    mission: Mission, reference: Floats, vehicle: Vehicle, trim_tables: Tables
) -> Floats:
    """Return LQR's gains as `make_lqr_gains`, with fewer knots in the ramps."""
    weights = CONTROLLERS["lqr"]
    if not isinstance(weights, LqrController):
        raise SystemExit("lqr.yaml is not an LQR controller")
    times = reference[:, 0]
    in_ramps = [np.linspace(*ramp, 13) for ramp in ramp_times(mission)]
    knots = np.unique(
        np.searchsorted(times, np.clip(np.concatenate([np.arange(0, 61), *in_ramps]), 0, times[-1]))
    )
    rows = reference[knots]
    n = _nominal(rows)
    columns = (
        20e3 + 0.0 * n.bank,
        n.flight_path_angle,
        n.heading,
        n.speed,
        n.angle_of_attack,
        n.bank,
        n.equivalence_ratio,
    )
    guidance = _slopes(
        lambda x: guidance_rates(vehicle, trim_tables, _AROUND, n.mass, x[:4], x[4:]),
        np.concatenate(columns, axis=1),
    )
    attitude = _attitude_slopes(vehicle, rows)
    pitch, roll_yaw = attitude[:, [0, 4]], attitude[:, [2, 1, 3, 5]]
    degree = np.pi / 180.0
    loops = (
        _regulators(guidance[:, :, :4], guidance[:, :, 4:], weights.guidance, 1.0),
        _regulators(pitch[:, :, [0, 4]], pitch[:, :, [8]], weights.longitudinal, degree),
        _regulators(roll_yaw[:, :, [2, 1, 3, 5]], roll_yaw[:, :, [6, 7]], weights.lateral, degree),
    )
    at_knots = np.concatenate(
        [gains_of_loop.reshape(len(rows), -1) for gains_of_loop in loops], axis=1
    )
    return np.stack([np.interp(times, times[knots], gain) for gain in at_knots.T], axis=1)


def make_quick_tlc_gains(reference: Floats, vehicle: Vehicle, trim_tables: Tables) -> Floats:
    """Return TLC's gains, computed at every fifth tick and interpolated."""
    controller = CONTROLLERS["tlc"]
    if not isinstance(controller, TlcController):
        raise SystemExit("tlc.yaml is not a TLC controller")
    times, some = reference[:, 0], reference[::5]
    gains = make_tlc_gains(controller, some, vehicle, trim_tables)
    return np.stack([np.interp(times, some[:, 0], gain) for gain in gains.T], axis=1)


_PLANS: dict[str, FlightPlan] = {}


def _base_plan(law: str) -> FlightPlan:
    if law not in _PLANS:
        _PLANS[law] = make_plan(BASE, BASE_MISSION, CONTROLLERS[law], law)
    return _PLANS[law]


def fly_candidate(values: dict[str, float]) -> Candidate:
    """Run the nominal flights of a candidate with both laws.

    Candidates whose nominal controls are far outside the axes are not simulated.
    """
    vehicle, mission = make_vehicle(values), make_mission(values)
    trim_tables = make_quick_trim_tables(vehicle)
    reference, trimmed = make_quick_reference(vehicle, mission, trim_tables)
    column = dict(zip(REFERENCE, reference.T, strict=True))
    channels = {
        "heading_deg": np.rad2deg(column["heading"]),
        "angle_of_attack_deg": np.rad2deg(column["angle_of_attack"]),
        "elevator_deg": np.rad2deg(column["elevator"]),
        "equivalence_ratio_command": column["equivalence_ratio"],
    }
    expected = tuple(
        look(axis, channels) if axis.channels[0] in channels else None for axis in AXES
    )
    outside = sum(sum(axis_result.misses) for axis_result in expected if axis_result is not None)
    off_node = float(np.abs(NODES - np.rad2deg(column["angle_of_attack"][0])).min())
    traits = find_traits(vehicle, trim_tables, reference)
    start_controls = {
        name: float(column[name][0])
        for name in ("angle_of_attack", "elevator", "equivalence_ratio")
    }
    class_traits = measure(vehicle, *start_controls.values())
    unflown = Candidate((), expected, traits, off_node, class_traits=class_traits)
    if not trimmed or outside > 2.5:
        return unflown
    start: dict[str, Any] = dict.fromkeys(TrimPoint._fields, 0.0) | {"fault": ""}
    start |= start_controls
    plan_items: dict[str, Any] = {
        "vehicle": vehicle,
        "trim_tables": trim_tables,
        "effectiveness": make_effectiveness(vehicle),
        "reference": reference,
        "initial_state": make_initial_state(mission, vehicle, TrimPoint(**start)),
    }
    flown: dict[str, dict[str, Floats]] = {}
    cycle = 0.0
    for law in LAWS:
        gains = (
            make_quick_tlc_gains(reference, vehicle, trim_tables)
            if law == "tlc"
            else make_quick_lqr_gains(mission, reference, vehicle, trim_tables)
        )
        block = fly(
            replace(_base_plan(law), **plan_items, gains=gains),
            nominal_parameters(),
            RECORDED,
            lanes=1,
        )
        if block.outcome[0] != Outcome.OK:
            return unflown
        flown[law] = dict(zip(SHOWN, block.history[0].T.astype(np.float64), strict=True))
        # Oscillations at the end are measured by the range of the surfaces' steps between samples.
        late = [
            float(np.ptp(np.diff(flown[law][name][-75:])))
            for name in ("elevator_deg", "aileron_deg")
        ]
        cycle += max(5.0 * sum(late) - 0.01, 0.0)
    seen = tuple(look_together(axis, flown) for axis in AXES)
    return Candidate(seen, expected, traits, off_node, cycle, class_traits)


def look_together(axis: Axis, flown: dict[str, dict[str, Floats]]) -> Seen:
    """Return the range on an axis that shows the laws together."""
    joined = {
        name: np.concatenate([flown[law][name] for law in axis.laws]) for name in axis.channels
    }
    times = np.tile(np.arange(round(TICKS * TICK / PERIOD) + 1) * PERIOD, len(axis.laws))
    return look(axis, joined, times)


def look(axis: Axis, channels: dict[str, Floats], times: Floats | None = None) -> Seen:
    """Return the range of channels in the paper's signs, and the misses of its ends."""
    values = np.concatenate([channels[name] for name in axis.channels if name in channels])
    if times is not None:
        inside = (times > axis.window[0] - 1e-9) & (times < axis.window[1] + 1e-9)
        values = values[np.tile(inside, len(axis.channels))]
    low, high = float(values.min()), float(values.max())
    if axis.figure == 4:  # the turn to the right mirrors the heading about east
        low, high = 180.0 - high, 180.0 - low
    straight, turned = _misses(axis, low, high), _misses(axis, -high, -low)
    if axis.mirror and sum(turned) < sum(straight):
        return Seen(axis, -high, -low, True, turned, _misses(axis, -high, -low, _INNER))
    return Seen(axis, low, high, False, straight, _misses(axis, low, high, _INNER))


def _misses(axis: Axis, low: float, high: float, inner: float = 0.0) -> tuple[float, float]:
    """Return the distances of the ends from their intervals as shares of the axis.

    With ``inner`` they are signed, negative below the interval.
    """
    misses = []
    for x, (least, most) in ((low, axis.lowest), (high, axis.highest)):
        room = inner * (most - least)
        misses.append((min(x - least - room, 0.0) + max(x - most + room, 0.0)) / axis.width)
    return (misses[0], misses[1]) if inner else (abs(misses[0]), abs(misses[1]))


def find_traits(vehicle: Vehicle, trim_tables: Tables, reference: Floats) -> tuple[float, ...]:
    """Return TRAITS at the start, in straight and level flight.

    Slopes of lift and drag are from there to the largest angle of attack.
    """
    slopes = _attitude_slopes(vehicle, reference[:1])[0]
    alpha = reference[:, REFERENCE.index("angle_of_attack")]
    ends = [0, int(np.argmax(alpha))]
    eta = reference[ends, REFERENCE.index("equivalence_ratio")]
    mach = reference[0, REFERENCE.index("speed")] / _AROUND.sound_speed
    rows = table_rows(
        trim_tables,
        make_variables(
            vehicle, mach=np.full(2, mach), angle_of_attack=alpha[ends], equivalence_ratio=eta
        ),
    )
    rise = np.diff(rows[1:3], axis=1)[:, 0] / (alpha[ends[1]] - alpha[0])
    moments = slopes[3, 6], slopes[5, 7], slopes[4, 8], slopes[5, 1], slopes[4, 0], slopes[4, 4]
    return tuple(float(x) for x in (*moments, *rise))


def third_trait(first: Any, second: Any) -> Floats:
    """Return the logarithmic factor by which vehicles [..., trait] differ in their third trait.

    Traits are ordered by their difference; different signs count as a factor of 2.
    """
    a, b = np.asarray(first), np.asarray(second)
    ratio = np.abs(np.log(np.abs(a) / np.abs(b)))
    return np.asarray(np.sort(np.where(a * b > 0.0, ratio, np.log(2.0)), axis=-1)[..., -3])
