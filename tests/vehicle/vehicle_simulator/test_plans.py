"""Stored plans, bit-identical and never executed, and exported gains."""

import ctypes
import io
import shutil
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import make_plan
from scipy.io import loadmat

from abhv_mc.folder.opening import read_plan, write_plan
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.design.reference import COLUMN_INDEX
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.plan_arrays import flatten, stored_arrays
from abhv_mc_vehicle.kernel.laws.columns import LQR_GAINS
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.stability.fly_with_margins import add_margins
from abhv_mc_vehicle.vehicle_simulator.export_gains import write_gains
from abhv_mc_vehicle.vehicle_simulator.make_plans import _find_jumps
from abhv_mc_vehicle.vehicle_simulator.stored_plans import code_of, rebuild_plan, rebuild_sent


def read(path, plan):
    return read_plan(path, lambda arrays: rebuild_plan(arrays, plan.vehicle))


def test_every_part_comes_back_with_its_type(tmp_path):
    plan = make_plan("one", 1.0 / 3.0)
    write_plan(tmp_path / "one.npz", plan)
    restored = read(tmp_path / "one.npz", plan)
    assert isinstance(restored, FlightPlan) and isinstance(restored.vehicle, type(plan.vehicle))
    assert isinstance(restored.timing.ticks, int) and isinstance(restored.timing.step, float)
    assert restored.controller == "one" and isinstance(restored.controller, str)
    old, new = flatten(plan), flatten(restored)
    assert old.keys() == new.keys()
    for name, value in old.items():
        assert value.dtype == new[name].dtype
        assert value.tobytes() == new[name].tobytes(), name


@pytest.mark.parametrize(
    ("heading", "of", "number"),
    [
        (-0.1, "heading_deg - 5", 1),
        (6.2, "abs(heading_measured_deg)", 1),
        (0.1, "sin(0.0174532925 * heading_deg)", 0),
        (0.1, "heading_error_deg", 0),
        (1.5, "heading_deg", 0),
    ],
)
def test_metrics_of_headings_that_jump_at_north_cause_a_warning(heading, of, number):
    plan = make_plan("one")
    reference = plan.reference.copy()
    reference[:, COLUMN_INDEX["heading"]] = heading
    campaign = SimpleNamespace(metrics={"own": replace(METRICS[0], name="own", of=of)})
    assert len([*_find_jumps({"one": replace(plan, reference=reference)}, campaign)]) == number


def test_a_sent_plan_flies_with_the_same_code():
    """Regression: workers compiled the full flight because plan files do not store ``lean``."""
    lean = replace(make_plan("one"), lean=True)
    sent = add_margins(lean, replace(make_plan("two"), lean=True), ("trim",))
    for plan in (lean, sent):
        restored = rebuild_sent(flatten(plan), code_of(plan))
        assert type(restored) is type(plan) and restored.lean
    assert restored.steady.lean
    full = replace(lean, lean=False)
    assert not rebuild_sent(flatten(full), code_of(full)).lean


def test_index_arrays_are_never_read(tmp_path):
    """Compiled code uses these indices without checking bounds."""
    plan = make_plan("one")
    assert not [
        name
        for name, value in stored_arrays(plan).items()
        if value.ndim and value.dtype.kind in "iu"
    ]
    hostile = {
        name: np.full_like(v, 10**9)
        for name, v in flatten(plan).items()
        if v.ndim and v.dtype.kind in "iu"
    }
    np.savez(tmp_path / "one.npz", **{**stored_arrays(plan), **hostile})
    restored = flatten(read(tmp_path / "one.npz", plan))
    assert len(hostile) > 10
    assert all(np.array_equal(restored[name], flatten(plan)[name]) for name in hostile)


@pytest.mark.parametrize(
    "name",
    [
        "vehicle.tables.data",
        "trim_tables.grid",
        "gains",
        "initial_state",
        "profile",
        "vehicle.effector_mix",
    ],
)
def test_arrays_of_another_shape_are_refused(tmp_path, name):
    plan = make_plan("one")
    parts = stored_arrays(plan)
    changed = parts[name][:, :-1] if parts[name].ndim == 2 else parts[name][:-1]
    np.savez(tmp_path / "one.npz", **{**parts, name: changed})
    with pytest.raises(InputError, match=rf"one\.npz: .*\b{name.removesuffix('.grid')}: "):
        read(tmp_path / "one.npz", plan)
    write_plan(
        tmp_path / "one.npz",
        replace(plan, timing=plan.timing._replace(ticks=plan.timing.ticks + 1)),
    )
    with pytest.raises(InputError, match="reference: shape"):
        read(tmp_path / "one.npz", plan)


def test_pickles_are_not_opened_and_damaged_or_missing_plans_are_named(tmp_path):
    pickled = io.BytesIO()
    np.savez(pickled, controller=np.array([object()], dtype=object))
    for content in (pickled.getvalue(), b"", b"PK\x03\x04 nothing"):
        (tmp_path / "bad.npz").write_bytes(content)
        with pytest.raises(InputError, match=r"bad\.npz"):
            read(tmp_path / "bad.npz", make_plan("one"))
    with pytest.raises(InputError, match=r"none\.npz"):
        read(tmp_path / "none.npz", make_plan("one"))


@pytest.fixture(scope="module")
def lqr():
    return make_flight_plan("level", "ghame_x", "lqr")


def test_mat_and_csv_hold_the_plans_gains(lqr, tmp_path):
    for ending in (".mat", ".csv"):
        write_gains(tmp_path / f"gains{ending}", lqr)
    contents = loadmat(tmp_path / "gains.mat")
    assert np.array_equal(contents["gains"], lqr.gains)
    assert [name.item() for name in contents["names"].ravel()] == list(LQR_GAINS)
    table = np.genfromtxt(tmp_path / "gains.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", *LQR_GAINS)
    assert np.array_equal(
        table["elevator_by_pitch_rate"], lqr.gains[:, LQR_GAINS.index("elevator_by_pitch_rate")]
    )
    with pytest.raises(InputError, match=r"\.txt"):
        write_gains(tmp_path / "gains.txt", lqr)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_arrays_hold_the_plans_gains(lqr, tmp_path):
    write_gains(tmp_path / "gains.h", lqr)
    text = '#include "gains.h"\ndouble at(int tick) { return gain[tick][GAIN_RUDDER_BY_BANK]; }\n'
    (tmp_path / "at.c").write_text(
        text + "double last(void) { return gain_time_s[GAIN_TICKS - 1]; }\n"
    )
    subprocess.run(["cc", "-shared", "-fPIC", "-o", "at.so", "at.c"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "at.so"))
    library.at.restype = library.last.restype = ctypes.c_double
    assert library.at(17) == lqr.gains[17, LQR_GAINS.index("rudder_by_bank")]
    assert library.last() == lqr.timing.duration
