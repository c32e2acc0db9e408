"""Outcomes, findings and dispersions of flights."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.statistic import Statistic
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.figures import draw_replayed, worst_channels
from abhv_mc.topics.flights.model import (
    Findings,
    FlightCounts,
    Flights,
    InputMoments,
    LargeDispersion,
    WorstFlight,
    _largest,
    _moments,
    channel_of,
    limit_sides,
    rank_failed,
    worst_flights,
)
from abhv_mc.topics.topic import Models, Records


def test_events_come_before_dispersions_sorted_by_their_distance():
    columns = {
        "wide": [0.0, 4.0, 2.0],
        "small": [0.1, 0.1, 0.4],
        "same": [5.0, 5.0, 5.0],
        "failure": [7.0, np.inf, np.inf],
    }
    moments = {name: _moments(np.array(column)) for name, column in columns.items()}
    flights = [{name: column[k] for name, column in columns.items()} for k in range(3)]
    sigma = 2.0 / np.sqrt(8.0 / 3.0)  # 0, 4 and 2 have a mean of 2
    first, second, third = _largest(flights[0], moments)
    assert first == LargeDispersion("failure", 7.0, None)
    assert (second.parameter, second.sigma) == ("wide", pytest.approx(-sigma))
    assert (third.parameter, third.sigma) == ("small", pytest.approx(-1 / np.sqrt(2.0)))
    assert [item.parameter for item in _largest(flights[2], moments)] == ["small", "wide", "same"]


def test_the_channel_of_a_metric_has_the_longest_equal_beginning():
    record = SimpleNamespace(of="bank_error_deg", name="x", statistic=Statistic.MAX_ABS)
    stems = {"bank_deg": "bank", "bank_error_2_deg": "bank_error"}
    assert channel_of(record, stems, stems) == "bank_error_2_deg"
    assert channel_of(record, ["bank_deg", "bank_error_deg"], stems) == "bank_error_deg"
    assert channel_of(record, ["mach"], {}) is None
    assert limit_sides(record, ["bank_error_deg"]) == (-1.0, 1.0)
    assert limit_sides(record, ["bank_deg"]) == ()


def test_outcomes_and_findings_are_counted(flown):
    """Of the flights, 3 terminate early, 4 saturate, 5 leave tables, and 2 oscillate."""
    results = flown(80)
    tlc = results.flights["tlc"]
    metrics, kinds = dict(tlc.metrics), {"saturates": 4, "leaves_tables": 5, "cycles": 2}
    for name, record in tlc.records.items():
        if record.finding and name in metrics:
            count = kinds[record.finding]
            high, low = (5.1, 5.0) if record.finding == "cycles" else (0.1, 0.0)
            metrics[name] = np.where(np.arange(80) < count, high, low)
    records = dict(tlc.records)
    for name in [
        name for name, record in records.items() if record.finding in ("saturates", "leaves_tables")
    ]:
        metrics[f"other_{name}"] = np.where(np.arange(80) < 1, 1.0, 0.0)
        records[f"other_{name}"] = replace(records[name], label=f"Other {records[name].label}")
    outcome = np.where(np.arange(80) < 3, 3, 0)
    changed = replace(
        tlc, records=records, metrics=metrics, outcome=outcome, absent=np.array([80, 81])
    )
    manifest = replace(
        results.manifest,
        controllers={
            **results.manifest.controllers,
            "gone": SimpleNamespace(outcomes={"failed_to_run": 9}),
        },
    )
    models = Models(
        replace(results, manifest=manifest, flights={**results.flights, "tlc": changed})
    )
    found = models[FLIGHTS]
    counts, findings = found.counts["tlc"], found.findings["tlc"]
    assert (counts.flown, counts.failed, counts.not_computed) == (80, 3, 2)
    assert counts.failure_share.value == 3 / 80 and found.left_out == {"gone": 9}
    assert counts.failure_share.low < 3 / 80 < counts.failure_share.high
    assert (findings.saturated, findings.outside_tables) == (4, 5)
    assert set(findings.cycling.values()) == {2}
    assert {*rank_failed(models.results, "tlc")} >= {0, 1, 2}


@pytest.mark.parametrize("can_rerun", [True, False])
def test_commands_that_fly_are_named_only_where_flights_can_be_run_again(
    flown, monkeypatch, can_rerun
):
    models = Models(flown(200))
    monkeypatch.setattr(type(models.names.campaign), "can_rerun", can_rerun)
    section = FLIGHTS.section(models[FLIGHTS], models.names)
    texts = " ".join(item.text for item in section.items if hasattr(item, "text"))
    assert ("abhv-mc explain" in texts) is can_rerun


def worst(flight, **entries):
    """Return a listed flight that completed the mission."""
    standard = {"outcome": Outcome.OK.code, "by": None, "beyond": 0.0, "missed": 0}
    return WorstFlight(
        flight=flight, **standard | {"metrics": {}, "samples": {}, "largest": ()} | entries
    )


@pytest.fixture
def found():
    """Return numbers of two controllers, of which the second terminated early at times."""
    parts = [{"distribution": "normal", "sigma": "2 %"}, {"distribution": "log_normal", "sigma": 3}]
    failed = FlightCounts(
        1200, 37, 4, {"ok": 1163, "sideslip_limit": 30, "bank_limit": 7}, Interval(0.03, 0.02, 0.04)
    )
    findings = Findings(1200, 4, 0, {"bank": 0, "angle_of_attack": 3})
    largest = (LargeDispersion("aero.lift", 0.92, -2.54), LargeDispersion("aero.drag", 1.1, None))
    return Flights(
        parameters=("aero.lift",),
        dispersions={
            "aero.lift": {"distribution": "mixture", "weights": [1, 2], "parts": parts},
            "aero.drag": {"distribution": "truncated_normal", "half_width": "8 %", "sigma": 0.04},
        },
        derived={"mass.total": "2 * aero.lift"},
        counts={"tlc": FlightCounts(1200, 0, 0, {"ok": 1200}, Interval(0, 0, 0)), "lqr": failed},
        left_out={},
        findings={"tlc": Findings(1200, None, None, {"bank": 2}, 5.0), "lqr": findings},
        worst={
            "tlc": (
                worst(7, by="sideslip_max_deg", beyond=-0.1234, missed=0,
                      metrics={"sideslip_max_deg": 0.61364}, largest=largest),
                worst(9, by="altitude_error_max_m", beyond=0.5, missed=2),
            ),
            "lqr": (worst(3, outcome="bank_limit", beyond=np.inf, missed=3), worst(4)),
        },
        inputs={"aero.lift": InputMoments(1.0, 0.05, 1.0012344, 0.0512345)},
    )  # fmt: skip


def section_of(found, results):
    section = FLIGHTS.section(found, Models(results).names)
    (records,) = (item for item in section.items if isinstance(item, Records))
    lines = dict(record.line.split(": ", 1) for record in records.records)
    return lines, {table.title: table for table in section.tables()}


def test_every_number_of_the_flights_has_its_cell(flown, found):
    lines, tables = section_of(found, flown(80))
    assert lines["Flights of each"] == "1200" and lines["Samples"] == "random"
    assert lines["Seed"] == "2014" and "aero.drag" in lines["Unknowns"]
    assert "Histories" not in lines and "Imported from" not in lines
    dispersions = {row[0]: row[2:] for row in tables["Dispersions"].plain_rows()}
    assert dispersions == {
        "`aero.lift`": ["mixture", "normal (sigma 2 %), log normal (sigma 3), weights [1, 2]"],
        "`aero.drag`": ["truncated normal", "half width 8 %, sigma 0.04"],
        "`mass.total`": ["derived", "2 * aero.lift"],
    }
    (inputs,) = (table for table in tables.values() if "Stated mean" in table.heads)
    assert inputs.plain_rows() == [["`aero.lift`", "-", "1.00000", "1.00123", "0.05000", "0.05123"]]
    assert tables["Outcomes of the flights"].plain_rows() == [
        ["TLC", "1200", "0", "0", "1200 ok"],
        ["LQR", "1200", "37", "4", "1163 ok, 30 sideslip limit, 7 bank limit"],
    ]
    findings = tables["Findings"]
    assert findings.heads[2:4] == ("Oscillation, angle of attack", "Oscillation, bank")
    assert findings.plain_rows() == [
        ["TLC", "0", "0", "2 of 1200", "0"],
        ["LQR", "4 of 1200", "3 of 1200", "0", "0"],
    ]
    assert " 5 deg" in findings.caption
    tlc, lqr = (tables[f"Worst flights of {name}"] for name in ("TLC", "LQR"))
    assert tlc.heads[2:5] == ("Worst in", "Exceedance (% of limit)", "Sideslip, max (deg)")
    largest = "lift −8.0\xa0% (−2.5 sigma), drag +10.0\xa0%"
    assert tlc.plain_rows() == [
        ["7", "completed", "Sideslip, max", "−12.3", "0.6136", largest],
        ["9", "completed; misses 2 of 3", "Altitude error, max", "50.0", "—", ""],
    ]
    assert [cell.flight for row in lqr.groups[0] for cell in row[:1]] == [("lqr", 3), ("lqr", 4)]
    assert [row[1] for row in lqr.plain_rows()] == ["bank limit", "completed"]


def test_tables_without_numbers_are_left_out(flown, found):
    nothing = replace(
        found,
        dispersions={},
        derived={},
        inputs={},
        counts={"tlc": found.counts["tlc"]},
        findings={"tlc": Findings(1200, None, 0, {"bank": 0})},
        worst={},
    )
    assert section_of(nothing, flown(80))[1] == {}
    for counts in (
        replace(found.counts["tlc"], failed=1),
        replace(found.counts["tlc"], not_computed=1),
    ):
        tables = section_of(replace(nothing, counts={"tlc": counts}), flown(80))[1]
        assert list(tables) == ["Outcomes of the flights"]


@pytest.mark.parametrize(
    ("changes", "kept", "line"),
    [((), 5, None), (("x",), 20, None), (("x",), 18, "58 of 60"), (("x",), 0, "40 of 60")],
)
def test_worst_flights_by_changed_requirements_may_lack_histories(
    flown, found, monkeypatch, changes, kept, line
):
    """The campaign keeps the worst 20 flights; LQR's have ``kept`` histories, and others more."""
    results = replace(flown(80), requirement_changes=changes)
    stored = {
        name: {*results.flights[name].flight[results.ranking.rows_of(name)].tolist()}
        for name in results.controllers
    }
    rows = results.ranking.rows_of("lqr")
    stored["lqr"] = {*results.flights["lqr"].flight[np.r_[rows[:kept], rows[20:50]]].tolist()}
    monkeypatch.setattr("abhv_mc.topics.flights.flights_with_history", lambda _, name: stored[name])
    lines, _ = section_of(found, results)
    assert lines.get("Histories", "").partition(" worst")[0] == (line or "")


def test_channels_are_sorted_by_the_number_of_flights_that_are_worst_in_them(flown):
    names = Models(flown(80)).names
    recorded = {"altitude_m", "altitude_error_m", "sideslip_deg", "bank_deg", "mach"}

    def channels(*flights):
        half = len(flights) // 2
        found = SimpleNamespace(worst={"tlc": flights[:half], "lqr": flights[half:]})
        return worst_channels(found, names, recorded)

    by = [worst(0, by=name) for name in ("sideslip_rms_deg", "bank_error_max_deg")]
    early = [worst(0, outcome=code) for code in ("bank_limit", "altitude_limit", "law_crashed")]
    assert channels(by[0], by[0], early[0], early[1], early[2], by[0], by[1]) == [
        "sideslip_deg",
        "bank_deg",
        "altitude_m",
    ]
    assert channels(by[0], early[0]) == ["bank_deg", "sideslip_deg"]
    assert channels(early[2]) == ["altitude_m", "sideslip_deg", "bank_deg"]  # of all curves


@pytest.mark.parametrize("stored", [(), (30, 4, 77, 78)])
def test_listed_flights_have_their_exceedance_metric_and_samples(flown, monkeypatch, stored):
    """Flights with histories are preferred; of the others, 20 are listed."""
    monkeypatch.setattr("abhv_mc.topics.flights.model.flights_with_history", lambda *_: {*stored})
    results, number = flown(80), np.arange(80)
    metrics = {
        "altitude_error_max_m": np.where(number == 30, 60.0, 10.0),
        "speed_error_max_mps": np.where(number >= 78, number / 4.0 - 13.25, 1.0),
        "sideslip_max_deg": np.where(number == 79, 0.84, number / 160.0),
    }
    tlc = results.flights["tlc"]
    outcome = np.where(number == 5, Outcome.BANK_LIMIT, Outcome.OK)
    tlc = replace(tlc, metrics={**tlc.metrics, **metrics}, outcome=outcome)
    listed = worst_flights(replace(results, flights={"tlc": tlc}))["tlc"]
    expected = [
        (5, "bank_limit", None, 3, np.inf),
        (79, "ok", "speed_error_max_mps", 2, 0.3),
        (78, "ok", "speed_error_max_mps", 1, 0.25),
        (30, "ok", "altitude_error_max_m", 1, 0.2),
        (77, "ok", "sideslip_max_deg", 0, pytest.approx(77 / 112 - 1.0)),
        (76, "ok", "sideslip_max_deg", 0, pytest.approx(76 / 112 - 1.0)),
    ]
    expected = [row for row in expected if not stored or row[0] in stored]
    found = [(item.flight, item.outcome, item.by, item.missed, item.beyond) for item in listed]
    assert found[: len(expected)] == [(*row[:4], pytest.approx(row[4])) for row in expected]
    assert len(listed) == (len(stored) or 20)
    for item in listed:
        for columns, values in ((metrics, item.metrics), (results.samples, item.samples)):
            assert all(values[name] == column[item.flight] for name, column in columns.items())


def drawn(found, names, monkeypatch, histories):
    """Return the figures of flights with given histories, by name."""
    monkeypatch.setattr(
        "abhv_mc.topics.flights.figures.read_histories", lambda _, name: histories.get(name, {})
    )
    return {text.name: (text, figure) for text, figure in FLIGHTS.figures(found, names)}


def test_critical_errors_are_from_the_command_the_reference_or_the_channel(failing, monkeypatch):
    """Each controller has its case; flights without history are skipped."""
    time = np.linspace(0.0, 60.0, 7)
    reference = failing.reference
    bank, command, error = 20.0 + time, 18.0 - 2.0 * time, np.sin(time)
    altitude = np.interp(time, reference["time"], reference["altitude_reference_m"]) + error
    histories = {
        "tlc": {2: {"time": time, "bank_deg": bank, "bank_command_deg": command}},
        "lqr": {5: {"time": time, "altitude_m": altitude, "sideslip_deg": error}},
        "lqr_retuned": {7: {"time": time, "altitude_m": altitude}},
    }
    names = Models(failing).names
    found = SimpleNamespace(
        worst={
            "tlc": (worst(1, by="sideslip_max_deg"), worst(2, by="bank_error_max_deg")),
            "lqr": (worst(5, outcome="sideslip_limit"),),
            "lqr_retuned": (worst(7, outcome="law_crashed"), worst(8)),
        }
    )
    figures = drawn(found, names, monkeypatch, histories)
    assert [*figures] == ["critical_errors"]
    panels = [axes for axes in figures["critical_errors"][1].axes if axes.get_visible()]
    expected = [
        (2, "Bank error from own command (deg)", bank - command, []),
        (5, "Sideslip (deg)", error, [-0.7, 0.7]),
        (7, "Altitude error (m)", error, [-50.0, 50.0]),
    ]
    for axes, (number, label, values, limits) in zip(panels, expected, strict=True):
        assert axes.texts[-1].get_text().endswith(f", flight {number}")
        assert axes.get_ylabel().replace("\n", " ") == label
        curve, *levels = axes.lines
        assert curve.get_xdata().tolist() == time.tolist()
        assert curve.get_ydata() == pytest.approx(values, abs=1e-9)
        assert [float(level.get_ydata()[0]) for level in levels] == limits


def test_ground_tracks_are_drawn_with_zones(failing, monkeypatch):
    zone = np.array([[50.0, 10.0], [51.0, 10.0], [51.0, 12.0]])  # latitude and longitude
    contents = replace(failing.campaign.contents, zones={"A": zone})
    names = Models(failing).names
    names = replace(names, campaign=replace(names.campaign, contents=contents))

    def track(k, **more):
        return {"time": np.arange(3.0), "latitude_deg": 50.0 + k * np.arange(3.0), **more}

    def longitude(k):
        return {"longitude_deg": 10.0 - k * np.arange(3.0)}

    histories = {
        "tlc": {1: track(1, **longitude(1)), 2: track(2, **longitude(2)), 3: track(3)},
        "lqr": {4: track(4, mach=np.ones(3), **longitude(4))},
    }
    nothing = SimpleNamespace(worst=dict.fromkeys(names.controllers, ()))
    ((_, figure),) = drawn(nothing, names, monkeypatch, histories).values()
    (axes,) = figure.axes
    assert axes.patches[0].get_xy()[:3].tolist() == zone[:, ::-1].tolist()
    for k, line in zip((1, 2, 4), axes.lines, strict=True):
        assert line.get_xdata().tolist() == longitude(k)["longitude_deg"].tolist()
        assert line.get_ydata().tolist() == track(k)["latitude_deg"].tolist()
    shown = axes.get_legend_handles_labels()[1]
    assert len(shown) == 2 and shown[0] == "TLC" and shown[1].startswith("LQR")
    first, second, third = (line.get_color() for line in axes.lines)
    assert first == second != third
    assert drawn(nothing, Models(failing).names, monkeypatch, histories) == {}


@pytest.mark.parametrize("has_nominal", [True, False])
def test_a_flight_that_was_run_again_is_drawn_beside_the_nominal_one(
    failing, monkeypatch, tmp_path, has_nominal
):
    """A channel with a limit replaces the curve of that label; a missing channel has no panel."""
    reference, names = failing.reference, Models(failing).names
    time = reference["time"]
    flight = {
        "time": time,
        "altitude_error_m": np.cos(time),
        "bank_deg": np.sin(time),
        "sideslip_deg": 0.01 * time,
    }
    nominal = {"tlc": {name: 2.0 * values for name, values in flight.items()} | {"time": time}}
    results = replace(failing, nominal=nominal if has_nominal else {})
    monkeypatch.setattr(
        "abhv_mc.topics.flights.figures.read_replayed", lambda path: ("tlc", 6, flight)
    )
    text, figure = draw_replayed(tmp_path / "tlc-6.parquet", replace(names, results=results))
    assert (text.name, text.title) == ("replayed_tlc-6", "Flight 6 of TLC")
    panels = {axes.texts[-1].get_text(): axes.lines for axes in figure.axes if axes.get_visible()}
    assert set(panels) == {"altitude error (m)", "bank (deg)", "sideslip (deg)"}
    sizes = (1.0, 2.0) if has_nominal else (1.0,)
    for title, channel, limits in (
        ("altitude error (m)", "altitude_error_m", [-50.0, 50.0]),
        ("sideslip (deg)", "sideslip_deg", [-0.7, 0.7]),
        ("bank (deg)", "bank_deg", []),
    ):
        curves = [line.get_ydata() for line in panels[title]]
        for size, curve in zip(sizes, curves, strict=False):
            assert curve == pytest.approx(size * flight[channel])
        levels = curves[len(sizes) : len(sizes) + len(limits)]
        assert [level[-1] for level in levels] == limits
        others = curves[len(sizes) + len(limits) :]
        assert len(others) == (channel == "bank_deg")
        assert all(np.array_equal(curve, reference["bank_reference_deg"]) for curve in others)
