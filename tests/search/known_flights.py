"""Flights whose metrics are known functions, and campaigns of them.

All probabilities and optima are known.
"""

from pathlib import Path

import numpy as np
from fake_flight import DENSITY, LIFT, make_plan, prepare, record, write_campaign

from abhv_mc.flights.blocks import FlightBlock, make_recording
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.interfaces import Engine
from abhv_mc_tune.request import TuneRequest
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX, METRICS

METRIC = "altitude_error_max_m"


def fly_line(plan, parameters, record_every=None):
    """A metric that is the lift's normal number: the probability of each limit is known."""
    lift = (parameters[:, LIFT] - 1.0) / 0.05
    metrics = np.tile(lift[:, None], (1, len(plan.metrics)))
    metrics[:, len(METRICS) - 1] = parameters[:, DENSITY]  # so that the trials see it matter
    ticks = plan.timing.ticks + 1
    history = (
        np.zeros((len(lift), ticks, len(CHANNELS)), np.float32)
        + parameters[:, [DENSITY]].astype(np.float32)[:, None]
    )
    ended = np.full(len(lift), int(Outcome.OK)), np.full(len(lift), 2.0)
    return record(
        FlightBlock(*ended, metrics, history, np.arange(ticks) * 0.1),
        make_recording(record_every, plan),
    )


LINE = Engine(prepare, fly_line, "line")
LIMIT = "[{metric: altitude_error_max_m, below: 4.0, probability: 0.9}]"


def write_line(folder, **entries):
    dispersions = (
        "{aero.lift: {distribution: normal, sigma: 5 %}, atmosphere.density: "
        "{distribution: uniform, half_width: 2 %}}"
    )
    return write_campaign(folder, **{"requirements": LIMIT, "dispersions": dispersions, **entries})


ERROR, TRAVEL = METRIC_INDEX["altitude_error_rms_m"], METRIC_INDEX["elevator_travel_deg"]
CONTROLLER = (Path(__file__).parents[2] / "configs/control/tlc.yaml").read_text("utf-8")
BLOCK = """\
free: [{key: altitude.damping, factor: 3}, {key: altitude.bandwidth, factor: 4}]
minimise: {metric: altitude_error_rms_m, quantile: 0.9}
limits:
  - {metric: elevator_travel_deg, quantile: 0.5, below_start_times: 1.5}
candidates: 113
validation: 200
"""


def prepare_tuned(vehicle, mission, controller, name):
    law = read_controller(controller)
    plan = make_plan(name)
    plan.gains[0, :2] = law.altitude.damping, law.altitude.bandwidth
    return plan


def fly_tuned(plan, parameters, record_every=None):
    """Compute an error that is least at a damping of 3 and a bandwidth of 0.06.

    The travel grows with the bandwidth.
    """
    damping, bandwidth = plan.gains[0, :2]
    lift = (parameters[:, LIFT] - 1.0) / 0.05
    metrics = np.zeros((len(lift), len(METRICS)))
    metrics[:, ERROR] = (
        1.0 + np.log(damping / 3.0) ** 2 + np.log(bandwidth / 0.06) ** 2 + 0.2 * np.abs(lift)
    )
    metrics[:, TRAVEL] = 100.0 * bandwidth + np.zeros(len(lift))
    outcome = np.where(lift > 2.5, int(Outcome.SIDESLIP_LIMIT), int(Outcome.OK))
    return FlightBlock(
        outcome,
        np.full(len(lift), 2.0),
        metrics,
        np.empty((len(lift), 0, 0), np.float32),
        np.empty(0),
    )


TUNED = Engine(prepare_tuned, fly_tuned, "tuned")


def write_tuned(folder):
    """A campaign, its controller and a file with the block; the request to tune it."""
    campaign = write_campaign(
        folder / "files", dispersions="{aero.lift: {distribution: normal, sigma: 5 %}}"
    )
    (folder / "files/one.yaml").write_text(CONTROLLER, "utf-8")
    (folder / "block.yaml").write_text(BLOCK, "utf-8")
    return TuneRequest(campaign, folder / "new.yaml", block=folder / "block.yaml", workers=2)
