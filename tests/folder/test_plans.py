"""Stored plans: every bit back, nothing executed."""

import numpy as np
import pytest
from fake_flight import make_plan

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.plans import flatten, read_plan, write_plan
from abhv_mc.io.input_error import InputError


def test_every_part_comes_back_with_its_type(tmp_path):
    plan = make_plan("one", 1.0 / 3.0)
    write_plan(tmp_path / "one.npz", plan)
    back = read_plan(tmp_path / "one.npz")
    assert isinstance(back, FlightPlan) and isinstance(back.vehicle, type(plan.vehicle))
    assert isinstance(back.timing.ticks, int) and isinstance(back.timing.step, float)
    assert back.controller == "one" and isinstance(back.controller, str)
    old, new = flatten(plan), flatten(back)
    assert old.keys() == new.keys()
    for name, value in old.items():
        assert value.dtype == new[name].dtype
        assert value.tobytes() == new[name].tobytes(), name


def test_pickles_are_not_opened(tmp_path):
    with (tmp_path / "bad.npz").open("wb") as file:
        np.savez(file, controller=np.array([object()], dtype=object))
    with pytest.raises(InputError, match="damaged plan"):
        read_plan(tmp_path / "bad.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing"])
def test_damaged_or_missing_plans_are_named(tmp_path, content):
    (tmp_path / "bad.npz").write_bytes(content)
    with pytest.raises(InputError, match="damaged plan"):
        read_plan(tmp_path / "bad.npz")
    with pytest.raises(InputError, match="no such file"):
        read_plan(tmp_path / "none.npz")
