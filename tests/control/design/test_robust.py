"""The shipped robust designs keep what they were searched for: margins, usage, flights with delay and effectiveness."""

from pathlib import Path

import pytest
from short_flights import rows_of

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import make_plan
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.stability.analysis import margins_of_flights
from abhv_mc.stability.steady import make_steady_plan
from abhv_mc.user_code.vehicle_functions import load_vehicle

CONFIGS = Path(__file__).parents[3] / "configs"
CORNERS = [(d, lift, drag) for d in (0.9, 1.1) for lift in (0.9, 1.1) for drag in (0.85, 1.15)]
USAGE = [f"{surface}_{kind}_deg" for surface in ("aileron", "elevator", "rudder") for kind in ("rms", "travel")]


@pytest.fixture(scope="module")
def setup():
    return load_vehicle(CONFIGS / "vehicle/ghame_x.yaml"), read_mission(CONFIGS / "mission/s_manoeuvre.yaml")


def _read(name):
    return read_controller(CONFIGS / "control" / f"{name}.yaml")


@pytest.mark.parametrize("name", ["tlc_robust", "lqr_robust"])
def test_margins_are_kept_nominally_and_at_the_corners_of_the_papers_box(setup, name):
    plan = make_steady_plan(*setup, _read(name), name)
    parameters = nominal_parameters(1 + len(CORNERS))
    columns = [PARAMETER_INDEX[key] for key in ("atmosphere.density", "aero.lift", "aero.drag")]
    parameters[1:, columns] = CORNERS
    found = margins_of_flights(plan, plan, parameters, ["trim"])
    least = found.table[:, :3].T
    assert (least[:, 0] >= (6.0, 35.0, 40.0)).all()
    assert (least[:, 1:].min(axis=1) >= (4.5, 30.0, 30.0)).all()


@pytest.mark.parametrize("name", ["tlc_robust", "lqr_robust"])
def test_wrong_effectiveness_and_delay_are_borne_at_no_more_usage(setup, name):
    """Table 1 cycles where the rudder is 1.2 times as effective; the settled bank error of these stays as it was."""
    factors = {"rudder": (1.2, 0.8), "aileron": (0.8,), "elevator": (0.8,)}
    cases = [{f"control.{surface}_effectiveness": x} for surface, each in factors.items() for x in each]
    parameters = rows_of({}, *cases, {"sensor.delay": 0.04})
    block = fly(make_plan(*setup, _read(name), name), parameters)
    table_1 = fly(make_plan(*setup, _read("tlc"), "tlc"), parameters[:2])
    settled = METRIC_INDEX["bank_error_settled_max_deg"]
    assert (block.outcome == Outcome.OK).all()
    assert (block.metrics[:, settled] < block.metrics[0, settled] + 0.5).all()
    assert table_1.metrics[1, settled] > table_1.metrics[0, settled] + 5.0
    usage = [METRIC_INDEX[key] for key in USAGE]
    assert (block.metrics[0, usage] <= 1.05 * table_1.metrics[0, usage]).all()


def test_tlcs_outer_bandwidths_stay_below_its_inner_ones():
    assert _read("tlc_robust").warnings() == []
