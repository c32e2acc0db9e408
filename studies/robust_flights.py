"""Evaluation of robust designs: uncertainties, flights, oscillations, margins and limits."""

import json
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from experiment import ALLOWED, DISPERSIONS, ERRORS, ROOT, USAGE, Floats, columns
from paper_vehicle_box import make_mission, make_vehicle

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.control.controller_file import Controller, TlcController, read_controller
from abhv_mc_vehicle.control.design.lqr_design import (
    gains_of_models,
    make_lqr_gains,
    make_lqr_models,
)
from abhv_mc_vehicle.control.design.tlc_design import make_tlc_gains, make_tlc_settings
from abhv_mc_vehicle.control.mission import Level, Mission, read_mission
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX, Vehicle
from abhv_mc_vehicle.stability.analysis import margins_of_flights
from abhv_mc_vehicle.stability.steady import make_steady_plan
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

NOMINAL = (6.0, 35.0, 40.0)  # dB, deg, ms: the least of every loop
CORNER = (4.5, 30.0, 30.0)
RIPPLE = 5.0  # deg
RIPPLES = tuple(f"{angle}_ripple_deg" for angle in ("angle_of_attack", "sideslip", "bank"))
LONG = 180.0  # s, duration of flights for counting cycles, some of which begin late
EFFECTIVENESS, LONGEST_DELAY = 0.20, 0.040  # s
SURFACES = ("aileron", "rudder", "elevator")
SEARCH_SEED, RANDOM = 2014, 55


def box_a(rows: Floats, signs: Floats) -> None:
    """Set density, lift and drag of ``rows`` to ``signs`` [row, 3] of the paper's half widths."""
    for (name, half_width), sign in zip(DISPERSIONS.items(), signs.T, strict=True):
        rows[:, PARAMETER_INDEX[name]] = 1.0 + half_width * sign


def box_b(rows: Floats, signs: Floats) -> None:
    """Set also effectiveness and delay of ``rows``, by ``signs`` [row, 7]."""
    box_a(rows, signs[:, :3])
    for name, sign in zip(SURFACES, signs[:, 3:6].T, strict=True):
        rows[:, PARAMETER_INDEX[f"control.{name}_effectiveness"]] = 1.0 + EFFECTIVENESS * sign
    rows[:, PARAMETER_INDEX["sensor.delay"]] = LONGEST_DELAY * 0.5 * (1.0 + signs[:, 6])


def paper_corners() -> Floats:
    """Return the nominal vehicle and the corners of the paper's box, ``[flight, parameter]``."""
    rows = nominal_parameters(9)
    box_a(rows[1:], np.array(list(product((-1.0, 1.0), repeat=3))))
    return rows


def random_flights(flights: int, seed: int) -> Floats:
    """Draw flights of box (b), ``[flight, parameter]``."""
    rows = nominal_parameters(flights)
    box_b(rows, np.random.default_rng(seed).uniform(-1.0, 1.0, (flights, 7)))
    return rows


def search_flights() -> Floats:
    """Return the flights of every candidate.

    They are :func:`paper_corners`, the 128 corners of box (b), and random flights in it.
    """
    corners = nominal_parameters(128)
    box_b(corners, np.array(list(product((-1.0, 1.0), repeat=7))))
    return np.vstack([paper_corners(), corners, random_flights(RANDOM, SEARCH_SEED)])


def read_case(vehicle: str) -> tuple[Vehicle, Mission]:
    """Return a member of the ensemble or `abhv` with its S, or a vehicle with `s_manoeuvre`."""
    for member in json.loads((ROOT / "studies/paper_vehicle.json").read_text(encoding="utf-8"))[
        "ensemble"
    ]:
        if member["name"] == vehicle:
            return make_vehicle(member["values"]), make_mission(member["values"])
    mission = "paper_s" if vehicle == "abhv" else "s_manoeuvre"
    return load_vehicle(ROOT / f"configs/vehicle/{vehicle}.yaml"), read_mission(
        ROOT / f"configs/mission/{mission}.yaml"
    )


@dataclass(frozen=True)
class Flown:
    """Results of flights of one controller."""

    errors: Floats  # [flight, ERRORS]
    usage: Floats  # [flight, USAGE]
    ripples: Floats  # [flight] largest of the three angles, deg; nan after an early termination

    @property
    def lost(self) -> int:
        """Number of flights that terminated early."""
        return int(np.isnan(self.ripples).sum())

    @property
    def cycling(self) -> int:
        """Number of flights with a ripple above RIPPLE."""
        return int((self.ripples > RIPPLE).sum())


class Duel:
    """Flights and margins of candidates of one law on one vehicle and mission."""

    def __init__(self, vehicle: str, law: str) -> None:
        self.vehicle, self.mission = read_case(vehicle)
        self.long = self.mission.model_copy(update={"duration": LONG})
        self.level = self.mission.model_copy(update={"manoeuvre": Level(kind="level")})
        self.corners, self.flights = paper_corners(), search_flights()
        table_1 = read_controller(ROOT / "configs/control/tlc.yaml")
        self.table_1_plan = make_plan(self.vehicle, self.mission, table_1, "tlc")
        self.table_1 = self.fly(self.table_1_plan, self.flights)
        base = read_controller(ROOT / f"configs/control/{law}.yaml")
        self.plan = make_plan(self.vehicle, self.mission, base, law)
        self.steady = make_steady_plan(self.vehicle, self.mission, base, law)
        if law == "lqr":
            times = self.plan.reference[:, ref.TIME]
            self.pieces = make_lqr_models(
                5.0, self.mission, self.plan.reference, self.vehicle, self.plan.trim_tables
            )
            self.times = times

    def fly(self, plan: FlightPlan, parameters: Floats) -> Flown:
        """Run flights with these parameters."""
        block = fly(plan, parameters)
        ripples = np.where(block.outcome == Outcome.OK, columns(block, RIPPLES).max(axis=1), np.nan)
        return Flown(columns(block, ERRORS), columns(block, USAGE), ripples)

    def plans(self, controller: Controller) -> tuple[FlightPlan, FlightPlan]:
        """Return the plans of a candidate for the S and steady flight.

        Raise LinAlgError if there is no regulator.
        """
        if isinstance(controller, TlcController):
            settings = make_tlc_settings(controller, self.vehicle)
            return tuple(  # type: ignore[return-value]
                replace(
                    plan,
                    gains=make_tlc_gains(
                        controller, plan.reference, self.vehicle, plan.trim_tables
                    ),
                    settings=settings,
                )
                for plan in (self.plan, self.steady)
            )
        steady = make_lqr_gains(
            controller, self.level, self.steady.reference, self.vehicle, self.steady.trim_tables
        )
        moving = gains_of_models(controller, self.pieces, self.times)
        return replace(self.plan, gains=moving), replace(self.steady, gains=steady)

    def margins(self, plan: FlightPlan, steady: FlightPlan) -> Floats:
        """Return the least margins ``[vehicle, (dB, deg, ms, disk)]`` of :func:`paper_corners`."""
        return margins_of_flights(plan, steady, self.corners, ["trim"]).table

    def score(self, flown: Flown) -> float:
        """Return the score to be minimized."""
        return float(
            np.mean((flown.errors.mean(axis=0) / np.median(self.table_1.errors, axis=0)) ** 4)
            ** 0.25
        )

    def excess(
        self, margins: Floats, flown: Flown | None, controller: Controller, ordered: bool
    ) -> list[float]:
        """Return the relative excess of each limit; limits on missing flights are violated."""
        required = np.vstack([[NOMINAL], np.tile(CORNER, (len(margins) - 1, 1))])
        short = ((required - margins[:, :3]) / required).max(axis=1)
        beyond = [float(short[0]), float(short[1:].max())]
        beyond += [order_excess(controller)] if ordered else []
        if flown is None:
            return [*beyond, *([1.0] * (2 + len(USAGE)))]
        usage = flown.usage[0] / (ALLOWED * self.table_1.usage[0]) - 1.0
        ripples = np.nanmax(flown.ripples, initial=0.0) / RIPPLE - 1.0
        return [
            *beyond,
            flown.lost / 10.0,
            min(float(ripples), 1.0),
            *np.minimum(usage, 1.0).tolist(),
        ]


def order_excess(controller: Controller) -> float:
    """Return the relative excess of TLC's outer crossovers over the inner ones they rely on."""
    if not isinstance(controller, TlcController):
        return 0.0
    outer, inner = controller.attitude, controller.rates
    pairs = (
        (outer.angle_of_attack, inner.pitch_rate),
        (outer.sideslip, inner.yaw_rate),
        (outer.bank, inner.roll_rate),
        (controller.velocity.flight_path_angle, outer.angle_of_attack),
        (controller.velocity.heading, outer.bank),
    )
    return sum(
        max(1.02 * max(slow.crossovers()) / min(fast.crossovers()) - 1.0, 0.0)
        for slow, fast in pairs
    )
