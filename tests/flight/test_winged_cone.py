"""The second vehicle flies: elevons, three-dimensional tables, centre of gravity aft of the moment reference."""

import numpy as np
import pytest

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.outcome import Outcome
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.one_flight.given import make_flight_plan

BOX = {"atmosphere.density": 0.10, "aero.lift": 0.10, "aero.drag": 0.15}


@pytest.mark.parametrize(
    "mission",
    [*(pytest.param(each, marks=pytest.mark.thorough) for each in ("level", "turn", "level_mach15")), "turn_mach15"],
)
def test_flies_level_and_turns_at_both_points(mission):
    """The nominal flight and the corners of the paper's box, with the gains of the paper's Table 1."""
    plan = make_flight_plan(mission, "winged_cone")
    parameters = nominal_parameters(9)
    for corner in range(8):
        for bit, (name, half_width) in enumerate(BOX.items()):
            parameters[1 + corner, PARAMETER_INDEX[name]] += half_width * (1 if corner >> bit & 1 else -1)
    block = fly(plan, parameters)
    assert np.array_equal(fly(plan, parameters[7:]).metrics, block.metrics[7:])  # 3-D cells shared or not
    metric = {name: block.metrics[:, i] for name, i in METRIC_INDEX.items()}
    assert block.outcome.tolist() == [Outcome.OK] * 9
    # Nominal, then worst of the corners; measured 7.4 and 26 m, 0.014 and 0.6 m/s, 0.014 and 0.04 deg.
    assert metric["altitude_error_max_m"][0] < 10.0
    assert metric["altitude_error_max_m"].max() < 40.0
    assert metric["speed_error_max_mps"][0] < 0.05
    assert metric["speed_error_max_mps"].max() < 1.0
    assert metric["angle_of_attack_error_rms_deg"].max() < 0.1
    assert metric["sideslip_max_deg"].max() < 0.02
    assert metric["surface_saturation_s"].max() == 0.0
    assert metric["outside_tables_s"].max() == 0.0
