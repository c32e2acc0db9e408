"""What needs no data: every row holds, and each check sees what it is there to see."""

import numpy as np
import pytest

from abhv_mc.plant import state as s
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.verification import invariants, look_up, order, roots
from abhv_mc.verification.everything import SECTIONS, scale_row, verify_sections
from abhv_mc.verification.rows import Row, all_ok, write_rows


@pytest.mark.parametrize("section", SECTIONS)
def test_section(section):
    rows = SECTIONS[section]()
    assert rows
    assert [row for row in rows if not row.ok] == []


def test_a_scale_multiplies_every_tolerance():
    rows = [row for _, section in verify_sections(1e-30) for row in section]
    assert not all_ok(rows)
    assert max(row.tolerance for row in rows) < 1e-28


def test_what_is_kept_is_kept_to_the_fourth_order():
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "ghame.yaml")
    drifts = []
    for step in (0.08, 0.04):
        ticks = round(20.0 / step)
        states = invariants.fly_in_vacuum(vehicle, step, ticks)
        position, velocity, body = invariants.to_inertial(states, step * np.arange(ticks + 1))
        momentum = body @ (states[:, s.ROLL_RATE : s.YAW_RATE + 1] @ invariants._inertia(vehicle))[..., np.newaxis]
        drifts.append([invariants._drift(np.cross(position, velocity)[:, 2]), invariants._drift(momentum[..., 0])])
        # the body really turns: its momentum in its own axes does not stay
        assert invariants._drift(states[:, s.ROLL_RATE : s.YAW_RATE + 1]) > 0.1
    assert (np.array(drifts[0]) / drifts[1] > 12.0).all()


def test_the_order_is_seen_where_it_is_lower():
    assert order.slope(np.array(order.STEPS) ** 3.0) == pytest.approx(3.0)
    for error in order.errors().values():
        assert (error[:-1] / error[1:] > 13.0).all()


def test_the_compiled_look_up_takes_any_number_of_points():
    tables = load_vehicle(shipped_configs() / "vehicle" / "winged_cone.yaml").tables
    variables = look_up.draw_points(tables, "outside", 35)
    assert np.array_equal(look_up.look_up_points(tables, variables), look_up.look_up_points(tables, variables))
    assert np.array_equal(
        look_up.look_up_points(tables, variables)[:, 7:9], look_up.look_up_points(tables, variables[:, 7:9])
    )


def test_root_cases_are_hard_ones():
    cases = roots.draw_cases()
    plain = getattr(roots.curve, "py_func", roots.curve)
    ends = np.array([[plain(row[3], *row[:3]), plain(row[4], *row[:3])] for row in cases])
    assert (ends[:, 0] * ends[:, 1] < 0.0).all()


def test_a_row_that_is_no_number_is_not_ok(tmp_path):
    good, bad = Row("a", "b", "c", "m", 1.0, 1.0), Row("a", "b", "d", "m", float("nan"), 1.0)
    assert good.ok
    assert not bad.ok
    assert not all_ok([])
    assert scale_row(good, 0.5).ok is False
    write_rows(tmp_path / "rows.json", [good, bad])
    assert '"ok": false' in (tmp_path / "rows.json").read_text().splitlines()[1]
    assert '"difference": null' in (tmp_path / "rows.json").read_text()
