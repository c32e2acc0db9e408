"""The lean probes of margins: less to compile, and the same bits."""

import numpy as np
import pytest
from stability.systems import flight_plan, parameters

from abhv_mc.stability import probe
from abhv_mc.stability.linearize import linearize
from abhv_mc.stability.points import flown_points


@pytest.mark.thorough
@pytest.mark.parametrize("controller", ["tlc", "lqr"])
def test_lean_probes_have_the_same_bits(controller, monkeypatch):
    plan = flight_plan(controller, 20.0).lean_for({"aero.lift", "aero.drag"})
    assert plan.lean
    dispersions = parameters(3, aero__lift=np.array([0.9, 1.0, 1.1]), aero__drag=0.85)
    made, found = [], []
    for lean in (True, False):
        monkeypatch.setattr(probe, "choose_probe", lambda make, _, lean=lean: made.append(lean) or make(lean))
        found.append(linearize(plan, flown_points(plan, dispersions, 8.0).points))
    assert set(made) == {True, False}
    for name, ours, full in zip(found[0]._fields, *found, strict=True):
        assert np.asarray(ours).tobytes() == np.asarray(full).tobytes(), name
