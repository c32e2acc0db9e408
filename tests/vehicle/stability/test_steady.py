"""Moves of the controller's points to equilibria, with replaced slopes."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc_vehicle.stability import steady
from abhv_mc_vehicle.stability.point_slopes import Points, Slopes


@pytest.mark.parametrize(("driven", "tried"), [(True, [1, 2, 3, 4]), (False, [3, 4])])
def test_points_with_any_control_off_its_command_or_saturated_come_to_rest(
    monkeypatch, driven, tried
):
    """A control is off at 1 and 2; 3 and 4 are saturated, 4 also in its equilibrium; 2 has none."""
    arrays = {name: np.zeros((5, 2)) for name in Points._fields[:-1]}
    value = np.zeros((5, 4))
    value[[0, 1, 2], [0, 3, 2]] = 9.0, 1e-3, -1e-3  # memory, and commands
    slopes = Slopes(value, np.zeros((5, 4, 2)), np.zeros(5))
    masks = iter([np.arange(5) >= 3, np.array(tried) == 4])

    def come_to_rest(plan, some, free):
        assert len(some.controls) == len(free.value) == len(tried)
        return some._replace(controls=some.controls + 5.0), np.array(tried) != 2

    monkeypatch.setattr(steady, "over_period", lambda *_: slopes)
    monkeypatch.setattr(steady, "_limited", lambda *_: next(masks))
    monkeypatch.setattr(steady, "mixes", lambda _: False)
    monkeypatch.setattr(steady, "_come_to_rest", come_to_rest)
    plan = SimpleNamespace(vehicle=SimpleNamespace(constants=SimpleNamespace(driven=driven)))
    points, limited = steady.leave_limits(plan, Points(**arrays, tick=0), np.zeros((5, 2)))
    assert limited.tolist() == [False, False, False, False, True]
    assert points.controls[:, 0].tolist() == [0.0, 5.0 * driven, 0.0, 5.0, 0.0]
