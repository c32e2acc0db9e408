"""Tests of the tables of channels, metrics and limits.

Declared metrics are compared with numpy on recorded channels.
"""

import dataclasses
import math
from functools import reduce

import numpy as np
import pytest
from short_flights import short_plan

from abhv_mc.flights.metrics import TAKES_LIMIT, pack_metrics, unpack_metrics
from abhv_mc.flights.outcomes import LAW_LOST, SENTENCES, Outcome
from abhv_mc.flights.statistic import Statistic
from abhv_mc.io.documents import Document
from abhv_mc.shipped import shipped_files
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.channels import (
    CHANNEL_INDEX,
    CHANNELS,
    REFERENCE_CHANNELS,
    SOURCES,
    SURFACES,
)
from abhv_mc_vehicle.flight.compile_metrics import compile_metrics, source_rows
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX, METRICS
from abhv_mc_vehicle.flight.plan import LIMITS, NO_SOURCES
from abhv_mc_vehicle.kernel.flight.interface import LANES, Z_ROWS
from abhv_mc_vehicle.kernel.flight.observe import find_row
from abhv_mc_vehicle.kernel.laws import user
from abhv_mc_vehicle.kernel.laws.columns import SETTLED
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.vehicle_simulator.keep_out import Zone
from abhv_mc_vehicle.vehicle_simulator.user_metrics import MetricEntry, declare_metrics

TICKS = 800
SQUARE = ((0.0, 0.0), (0.1, 0.0), (0.1, 0.08), (0.0, 0.08))


def repeat(metric):
    """Return a built-in metric as a campaign file declares it.

    Infinite empty values are omitted.
    """
    entry = {"of": metric.of, "statistic": metric.statistic.word, "settled": metric.settled}
    entry |= {"limit": metric.limit} if metric.statistic in TAKES_LIMIT else {}
    return entry | ({"empty": metric.empty} if math.isfinite(metric.empty) else {})


def declare(plan, mission=None, **entries):
    errors = []
    models = {name: MetricEntry(**entry) for name, entry in entries.items()}
    document = Document("metrics.yaml", {}, {(): (1, 1)}, {})
    declared = declare_metrics(models, (), document, (), errors, mission=mission)
    assert not errors, errors
    return dataclasses.replace(plan, declared=pack_metrics(declared))


@pytest.fixture(scope="module")
def plan():
    """Plan of the first 8 s of the S manoeuvre.

    The bank steps at the start, so the first 5 s are transients.
    """
    return short_plan(TICKS, "lqr_retuned_ghame_x")


@pytest.fixture(scope="module")
def parameters():
    rows = nominal_parameters(LANES + 3)
    generator = np.random.default_rng(4)
    rows[:, PARAMETER_INDEX["aero.lift"]] = generator.uniform(0.8, 1.2, len(rows))
    rows[::4, PARAMETER_INDEX["actuator.deflection_limit"]] = (
        0.05  # some lose control and end early
    )
    rows[1, PARAMETER_INDEX["initial.angle_of_attack"]] = 0.5  # at the first tick
    return rows


ENTRIES = {
    "least": {"of": "pitch_rate_dps", "statistic": "min"},
    "most": {"of": "pitch_rate_dps", "statistic": "max"},
    "size": {"of": "pitch_rate_dps", "statistic": "max_abs"},
    "middle": {"of": "bank_deg", "statistic": "mean"},
    "root": {"of": "bank_error_deg", "statistic": "rms"},
    "last": {"of": "bank_error_deg", "statistic": "final"},
    "sum": {"of": "mach", "statistic": "integral"},
    "swing": {"of": "bank_error_deg", "statistic": "peak_to_peak", "from": "2 s", "to": "6 s"},
    "path": {"of": "elevator_deg", "statistic": "travel"},
    "outside": {"of": "bank_error_deg", "statistic": "time_outside", "limit": 1.0},
    "mostly": {
        "of": "abs(bank_error_deg)",
        "statistic": "quantile",
        "share": 0.95,
        "settled": True,
    },
    "seldom": {
        "of": "pitch_rate_dps",
        "statistic": "quantile",
        "share": 0.025,
        "from": "2 s",
        "to": "6 s",
    },
    "settling": {"of": "bank_error_deg", "statistic": "last_outside", "limit": 1.0},
    "begins": {"of": "altitude_error_m", "statistic": "first_outside", "limit": 0.05},
    "turns": {"of": "pitch_rate_dps", "statistic": "reversals"},
    "large_turns": {"of": "bank_error_deg", "statistic": "reversals", "limit": 0.5},
    "late_swing": {"of": "bank_error_deg", "statistic": "peak_to_peak", "settled": True},
    "mixed": {
        "of": "sqrt(abs(pitch_rate_dps) + 1) * min(mach, 3, 5) - -bank_deg / 2",
        "statistic": "max",
    },
    "wave": {"of": "max(sin(bank_deg * 0.02), cos(mach))", "statistic": "min"},
    "never": {"of": "mach", "statistic": "mean", "from": "100 s"},
}


def reversals(x, _, limit):
    """Turning points by a walk over the samples."""
    turn, sense, count = x[0], 0, 0
    for value in x[1:]:
        moved = value - turn
        if sense == 0:
            if abs(moved) > limit:
                sense, turn = np.sign(moved), value
        elif moved * sense > 0:
            turn = value
        elif abs(moved) > limit and moved != 0:
            sense, turn, count = -sense, value, count + 1
    return count


# Statistics of values at times (s), with their limit or share.
STATISTICS = {
    "min": lambda x, *_: x.min(),
    "max": lambda x, *_: x.max(),
    "max_abs": lambda x, *_: np.abs(x).max(),
    "mean": lambda x, *_: x.mean(),
    "rms": lambda x, *_: np.sqrt((x**2).mean()),
    "final": lambda x, *_: x[-1],
    "integral": lambda x, t, _: np.trapezoid(x, t),
    "peak_to_peak": lambda x, *_: np.ptp(x),
    "travel": lambda x, *_: np.abs(np.diff(x)).sum(),
    "time_outside": lambda x, _, limit: 0.01 * (np.abs(x) > limit).sum(),
    "last_outside": lambda x, t, limit: t[np.abs(x) > limit].max(initial=t[0]),
    "first_outside": lambda x, t, limit: t[np.abs(x) > limit].min(initial=t[-1]),
    "quantile": lambda x, _, share: np.quantile(x, share),
    "reversals": reversals,
}
IN_EXPRESSIONS = {name: getattr(np, name) for name in ("abs", "sqrt", "sin", "cos")}
IN_EXPRESSIONS |= {"min": lambda *x: reduce(np.minimum, x), "max": lambda *x: reduce(np.maximum, x)}


def expected(entry, channels, settled):
    """Evaluate the expression in Python and the statistic in numpy; NaN if no tick counts."""
    x = eval(entry["of"], IN_EXPRESSIONS, channels)  # noqa: S307
    t = 0.01 * np.arange(len(x))
    start, end = (
        float(entry.get(name, default).removesuffix(" s"))
        for name, default in (("from", "0"), ("to", "inf"))
    )
    is_counted = (
        (t > start - 1e-9) & (t < end + 1e-9) & (settled[: len(t)] | (not entry.get("settled")))
    )
    limit = entry.get("limit", entry.get("share", 0.0))
    return (
        STATISTICS[entry["statistic"]](x[is_counted], t[is_counted], limit)
        if is_counted.any()
        else np.nan
    )


def test_every_statistic_agrees_with_numpy(plan, parameters):
    block = fly(declare(plan, **ENTRIES), parameters, 1)
    ended = block.outcome != Outcome.OK
    assert 0 < ended.sum() < len(ended)
    settled = plan.reference[:, SETTLED] > 0.0
    assert 0 < settled[: TICKS + 1].sum() < TICKS
    for flight, history in enumerate(block.history.astype(np.float64)):
        flown = history[np.isfinite(history[:, CHANNEL_INDEX["altitude_m"]])]
        channels = {name: flown[:, i] for name, i in CHANNEL_INDEX.items()}
        for (name, entry), value in zip(
            ENTRIES.items(), block.metrics[flight, len(METRICS) :], strict=True
        ):
            reference = expected(entry, channels, settled)
            slack = 2 if name == "turns" else 0  # turns of noise that float32 rounds away
            assert np.isclose(value, reference, rtol=2e-5, atol=2e-4 + slack, equal_nan=True), (
                flight,
                name,
                value,
                reference,
            )


def test_formulas_are_evaluated_at_every_tick_of_the_record(plan, parameters):
    """Check windows, flights that end early, and a response to the bank step at 0 s."""
    response = {"to": "transients", "within": "2 s", "holds": "3 s", "below": "3 deg"}
    formula = "abs(bank_error_deg) < 3 until[0.5, 4] abs(pitch_rate_dps) < 1"
    mission = read_mission(shipped_files("mission")["s_manoeuvre"])
    declared = declare(
        plan,
        mission,
        settles={"of": "bank_error_deg", "response": response, "to": "8 s"},
        calm={"of": formula, "from": "2 s", "to": "6 s", "empty": -9.0},
    )
    block = fly(declared, parameters, 1)
    assert declared.metrics[-2].unit == "deg" and declared.metrics[-2].bad == "low"
    for history, metrics in zip(block.history.astype(np.float64), block.metrics, strict=True):
        bank, rate = (
            limit - np.abs(history[:, CHANNEL_INDEX[name]])
            for name, limit in (("bank_error_deg", 3.0), ("pitch_rate_dps", 1.0))
        )
        count = int(np.isfinite(history[:, CHANNEL_INDEX["altitude_m"]]).sum())
        settles = max(bank[k : min(k + 301, count)].min() for k in range(min(201, count)))
        calm = max(
            (min(rate[k], bank[200:k].min()) for k in range(250, min(601, count))), default=-9.0
        )
        assert np.isclose(metrics[-2:], [settles, calm], rtol=2e-5, atol=2e-4).all()
    assert {-9.0} < set(block.metrics[:, -1])
    late = {"of": "mach", "response": response | {"to": "speed_reference_mps"}, "to": "7 s"}
    with pytest.raises(AssertionError, match="has no step from 0 to 5 s"):
        declare(plan, mission, late=late)


def test_a_declared_metric_that_repeats_a_built_in_one_gives_its_bits(plan, parameters):
    counted = compile_metrics(
        METRICS, source_rows(NO_SOURCES)
    )  # in the lean loop, and the repeated ones not
    assert (
        counted.lean.column.tolist() == list(range(len(METRICS)))
        and not counted.programs.column.size
    )
    entries = {f"own_{metric.name}": repeat(metric) for metric in METRICS}
    entries |= {
        f"own_way_of_{name}": {"of": f"{name}_deg", "statistic": "travel"} for name in SURFACES
    }
    declared, builtin = fly(declare(plan, **entries), parameters), fly(plan, parameters)
    assert np.array_equal(declared.metrics[:, : len(METRICS)], builtin.metrics)
    for i, metric in enumerate(METRICS):
        repeated, original = declared.metrics[:, len(METRICS) + i], builtin.metrics[:, i]
        assert np.array_equal(repeated, original), metric.name
    for i, name in enumerate(SURFACES):
        repeated = declared.metrics[:, 2 * len(METRICS) + i]
        assert np.array_equal(repeated, builtin.metrics[:, METRIC_INDEX[f"{name}_travel_deg"]]), (
            name
        )


def test_a_tick_that_is_not_a_number_makes_the_metric_not_a_number(plan, parameters):
    """GHAME-X has no nose radius: its NaN heat flux was above the limit for 0 s and passed."""
    entries = {}
    for i, source in enumerate(
        ("stagnation_heat_flux_w_m2", "sqrt(pitch_rate_dps)", "max(0, sqrt(pitch_rate_dps))")
    ):
        for statistic in Statistic:
            limit = {"limit": 1.0} if statistic in TAKES_LIMIT else {}
            limit |= {"share": 0.5} if statistic == Statistic.QUANTILE else {}
            entries[f"m{i}_{statistic.word}"] = {
                "of": f"always({source} < 1)" if statistic == Statistic.ROBUSTNESS else source,
                "statistic": statistic.word,
                "empty": 0.0,
                **limit,
            }
    some, every = (
        {k: v for k, v in entries.items() if k < "m2"},
        {k: v for k, v in entries.items() if k >= "m2"},
    )
    for declared in (some, every):
        block = fly(declare(plan, **declared), parameters[2:4])
        assert (block.outcome == Outcome.OK).all() and np.isnan(
            block.metrics[:, len(METRICS) :]
        ).all()
    before = {"early": {"of": "sqrt(2.0 - altitude_error_m)", "statistic": "max", "to": "0.01 s"}}
    assert np.isfinite(fly(declare(plan, **before), parameters[2:4]).metrics[:, -1]).all()


def test_quantiles_do_not_depend_on_the_number_of_flights():
    """Check that the memory for ticks does not grow with the number of flights.

    They are simulated in groups.
    """
    entry = {"of": "pitch_rate_dps", "statistic": "quantile", "share": 0.025}
    changed, rows = (
        declare(short_plan(50, "lqr_retuned_ghame_x"), low=entry),
        nominal_parameters(600),
    )
    rows[:, PARAMETER_INDEX["aero.lift"]] = np.linspace(0.9, 1.1, 600)
    block = fly(changed, rows)
    assert (
        np.array_equal(block.metrics[500:], fly(changed, rows[500:]).metrics)
        and len(set(block.metrics[:, -1])) > 500
    )


def test_records_come_back_from_their_text(plan):
    changed = declare(plan, **ENTRIES)
    restored = unpack_metrics(changed.declared)
    assert [repr(metric) for metric in restored] == [
        repr(metric) for metric in changed.metrics[len(METRICS) :]
    ]
    assert {metric.bad for metric in restored if metric.statistic.word == "min"} == {"low"}


def test_tables_name_everything_once_and_every_source_has_a_row():
    for table in (CHANNELS, tuple(SOURCES.values()), METRICS, REFERENCE_CHANNELS):
        assert len({signal.name for signal in table}) == len(table)
    assert set(SENTENCES) == set(Outcome)
    assert user.NOT_FINITE == Outcome.NOT_FINITE
    without_limit = {Outcome.NOT_FINITE, Outcome.FAILED_TO_RUN, Outcome.LAW_FAILED, *LAW_LOST}
    without_limit |= {Outcome.STATE_LIMIT}  # of custom states, which are not in LIMITS
    # OK stands for the end condition of the mission.
    assert {limit.outcome for limit in LIMITS} == set(Outcome) - without_limit
    for entry in (*SOURCES.values(), *LIMITS):
        assert s.X <= find_row(entry.source) < Z_ROWS


def test_distances_from_zones_are_those_of_the_recorded_positions(plan, parameters):
    corners = [(f"{29.2 + y} deg", f"{x - 77.9} deg") for x, y in SQUARE]
    zones = Zone(center=("29.25 deg", "-77.9 deg"), radius="3 km"), Zone(polygon=corners)
    entries = {
        f"zone_{i}": {"of": zone.expression(), "statistic": Statistic.MIN.word}
        for i, zone in enumerate(zones)
    }
    block = fly(declare(plan, **entries), parameters[2:4], 1, keep_states=True)
    names = {name: getattr(math, name) for name in ("sin", "cos", "sqrt")}
    names |= {"min": min, "max": max}
    for flight, states in enumerate(block.states):
        positions = np.degrees(states[np.isfinite(states[:, 1]), 1:3])
        for i, entry in enumerate(entries.values()):
            code = compile(f"({entry['of']})", "zone", "eval")
            distances = [
                eval(code, {**names, "longitude_deg": x, "latitude_deg": y})  # noqa: S307
                for x, y in positions
            ]
            found = block.metrics[flight, len(METRICS) + i]
            assert found == pytest.approx(min(distances), abs=1e-5)
