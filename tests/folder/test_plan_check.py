"""A plan from a stranger's folder: whatever is in it, compiled code gets none that leads it out of its arrays."""

import random
from dataclasses import replace

import numpy as np
import pytest
from fake_flight import make_plan

from abhv_mc.flight.metrics import METRICS, Metric, Statistic, pack_metrics
from abhv_mc.folder.plans import flatten, read_plan, write_plan
from abhv_mc.io.input_error import InputError


@pytest.fixture(scope="module")
def parts():
    return flatten(make_plan("one"))


def refuse(tmp_path, parts):
    path = tmp_path / "one.npz"
    np.savez(path, **parts)
    with pytest.raises(InputError, match="damaged plan") as refused:
        read_plan(path)
    return str(refused.value)


def test_no_index_may_be_large_or_negative(tmp_path, parts):
    chance = random.Random(7)
    tried = 0
    for name, value in parts.items():
        if value.dtype == np.int64 and value.size and name.startswith(("vehicle", "trim", "effect")):
            for wrong in (10**9, -1, -(10**9), np.iinfo(np.int64).max, np.iinfo(np.int64).min):
                other = value.copy().reshape(-1)
                other[chance.randrange(other.size)] = wrong
                refuse(tmp_path, parts | {name: other.reshape(value.shape)})
                tried += 1
    assert tried > 100


def test_every_array_has_its_type_shape_and_finite_numbers(tmp_path, parts):
    for name, value in parts.items():
        if value.dtype.kind == "f" and value.size:
            assert "finite" in refuse(tmp_path, parts | {name: np.full_like(value, np.nan)})
        if value.dtype.kind in "if" and value.ndim:
            refuse(tmp_path, parts | {name: value.astype(np.float32)})
            refuse(tmp_path, parts | {name: value.astype(">f8")})
        if value.ndim and value.size and name not in ("vehicle.tables.data", "trim_tables.data"):
            refuse(tmp_path, parts | {name: np.concatenate([value, value])})
        if value.dtype.kind in "ifU":
            refuse(tmp_path, parts | {name: value[None]})
        refuse(tmp_path, {other: content for other, content in parts.items() if other != name})


@pytest.mark.parametrize("ticks", [0, -1, 5, 10**12])
def test_the_clock_fits_the_reference(tmp_path, parts, ticks):
    refuse(tmp_path, parts | {"timing.ticks": np.asarray(ticks)})


def test_the_order_in_memory_is_what_compiled_code_expects(tmp_path, parts):
    np.savez(tmp_path / "one.npz", **parts | {"gains": np.asfortranarray(parts["gains"])})
    plan = read_plan(tmp_path / "one.npz")
    assert plan.gains.flags.c_contiguous and plan.gains.flags.aligned
    write_plan(tmp_path / "again.npz", plan)
    assert np.array_equal(read_plan(tmp_path / "again.npz").gains, plan.gains)


@pytest.fixture(scope="module")
def declared():
    metric = Metric("mine_m", "m", "of the campaign", "Mine", "low", "user", "altitude_m + 2", Statistic.MIN)
    return flatten(replace(make_plan("one"), declared=pack_metrics([metric])))


def test_a_declared_metric_comes_back(tmp_path, declared):
    np.savez(tmp_path / "one.npz", **declared)
    (metric,) = read_plan(tmp_path / "one.npz").metrics[len(METRICS) :]
    assert (metric.bad, metric.statistic, metric.end) == ("low", Statistic.MIN, np.inf)


def test_its_text_is_compiled_anew(tmp_path, declared):
    for place in range(declared["declared"].shape[1]):
        other = declared["declared"].astype("<U40")
        other[0, place] = "__import__('os')\n"
        refuse(tmp_path, declared | {"declared": other})
    refuse(tmp_path, declared | {"declared": declared["declared"][:, 1:]})
    refuse(tmp_path, declared | {"own_sources": np.array(["one"])})


def test_bounds_may_be_infinite_and_nothing_else(tmp_path, parts):
    np.savez(tmp_path / "one.npz", **parts | {"limits.altitude_max": np.asarray(np.inf)})
    assert read_plan(tmp_path / "one.npz").limits.altitude_max == np.inf
    for name in ("timing.step", "settings", "vehicle.constants.area"):
        assert "finite" in refuse(tmp_path, parts | {name: np.full_like(parts[name], np.inf)})
