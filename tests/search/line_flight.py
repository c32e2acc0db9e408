"""A flight whose metrics are the lift's normal number, and a campaign of it: every probability and optimum is known."""

import numpy as np
from fake_flight import DENSITY, LIFT, prepare, record, write_campaign

from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.metrics import METRICS
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, recording_of
from abhv_mc.simulators.engine import Engine

METRIC = "altitude_error_max_m"


def fly_line(plan, parameters, record_every=None):
    """A metric that is the lift's normal number: the probability of each limit is known."""
    lift = (parameters[:, LIFT] - 1.0) / 0.05
    metrics = np.tile(lift[:, None], (1, len(plan.metrics)))
    metrics[:, len(METRICS) - 1] = parameters[:, DENSITY]  # so that the trials see it matter
    ticks = plan.timing.ticks + 1
    history = (
        np.zeros((len(lift), ticks, len(CHANNELS)), np.float32) + parameters[:, [DENSITY]].astype(np.float32)[:, None]
    )
    ended = np.full(len(lift), int(Outcome.OK)), np.full(len(lift), 2.0)
    return record(FlightBlock(*ended, metrics, history, np.arange(ticks) * 0.1), recording_of(record_every, plan))


LINE = Engine(prepare, fly_line, "line")
LIMIT = "[{metric: altitude_error_max_m, below: 4.0, probability: 0.9}]"


def write_line(folder, **entries):
    dispersions = (
        "{aero.lift: {distribution: normal, sigma: 5 %}, atmosphere.density: {distribution: uniform, half_width: 2 %}}"
    )
    return write_campaign(folder, **{"requirements": LIMIT, "dispersions": dispersions, **entries})
