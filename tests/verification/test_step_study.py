"""What the integrator's default step costs: the metrics of dispersed flights at 10 ms against 5 ms."""

import numpy as np
from verification.shown import check

from abhv_mc.array_types import Floats
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRICS
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.one_flight.given import make_flight_plan
from abhv_mc.verification.check_rows import Row

# Zhu & Shen (2014), section 7: uniform, half widths.
_DISPERSIONS = {"atmosphere.density": 0.10, "aero.lift": 0.10, "aero.drag": 0.15}
FLIGHTS = 304
_SHARE = 0.01  # of a metric's spread


def draw_parameters(flights: int, seed: int = 2014) -> Floats:
    """The paper's dispersions, ``[flight, parameter]``."""
    generator = np.random.default_rng(seed)
    parameters = nominal_parameters(flights)
    for name, half_width in _DISPERSIONS.items():
        parameters[:, PARAMETER_INDEX[name]] += generator.uniform(-half_width, half_width, flights)
    return parameters


def fly_at(step: float, parameters: Floats) -> FlightBlock:
    """TLC's S manoeuvre with an integrator step (s)."""
    return fly(make_flight_plan({"base": "s_manoeuvre", "step": f"{step} s"}, "ghame_x"), parameters)


def test_half_the_step_moves_every_metric_by_less_than_one_percent_of_its_spread() -> None:
    default = make_flight_plan("s_manoeuvre", "ghame_x").timing.step
    parameters = draw_parameters(FLIGHTS)
    coarse, fine = (fly_at(step, parameters) for step in (default, 0.5 * default))
    flown = f"tlc, {FLIGHTS} flights"
    changed = float((coarse.outcome != fine.outcome).sum())
    rows = [Row("half the step", flown, "outcomes that change", "-", changed, 0.0)]
    spread = np.std(fine.metrics, axis=0)
    change = np.abs(coarse.metrics - fine.metrics).max(axis=0)
    share = np.divide(change, spread, out=change.copy(), where=spread > 0.0)
    rows += [
        Row("half the step", flown, metric.name, "of its spread", float(value), _SHARE)
        for metric, value in zip(METRICS, share, strict=True)
    ]
    check(rows)
