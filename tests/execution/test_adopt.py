"""Flights that somebody else has flown, in a table."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from own_simulators import DIVE, dive_campaign, shown_text

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.execution.adopt import adopt_table
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.export import export_csv
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.compare_page import compare_folders
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.simulators.engine import make_engine


@pytest.fixture
def flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The exported table of a campaign of 300 flights of two systems."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    run_campaign(Request(dive_campaign(tmp_path / "own", runs=300), tmp_path / "flown"))
    return next(path for path in export_csv(tmp_path / "flown", tmp_path) if path.name == "flights.csv")


def asked(tmp_path: Path, **changes: Any) -> Path:
    """The campaign that adopts it."""
    return dive_campaign(tmp_path / "asked", **{"simulator": None, "runs": None, "independent": True, **changes})


def rewritten(table: Path, change: Any) -> Path:
    """The table with ``change`` of each row (a dictionary)."""
    with table.open(newline="") as file:
        rows = [change(i, row) for i, row in enumerate(csv.DictReader(file), 2)]
    path = table.with_name("changed.csv")
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def plain_inputs(tmp_path: Path) -> dict[str, Any]:
    """Without the one that nothing disperses: the export has no column of it."""
    inputs = json.loads(asked(tmp_path).read_text())["inputs"]
    return {"inputs": {name: entry for name, entry in inputs.items() if name != "dive"}}


def test_an_adopted_table_gives_the_same_verdicts_comparison_and_rules(flown: Path, tmp_path: Path) -> None:
    result = adopt_table(flown, asked(tmp_path, **plain_inputs(tmp_path)), tmp_path / "adopted")
    ours, theirs = read_flown(tmp_path / "flown"), read_flown(tmp_path / "adopted")
    assert result.complete
    assert theirs.manifest.requirements == ours.manifest.requirements
    assert theirs.manifest.digest == ours.manifest.digest
    for folder in ("flown", "adopted"):
        build_report(tmp_path / folder)
    first, second = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("flown", "adopted"))
    for topic in ("verdicts", "comparison", "drivers", "metrics"):
        assert second[topic] == first[topic]
    assert second["failures"]["controllers"] == first["failures"]["controllers"]
    assert not list(verify_campaign(tmp_path / "adopted"))


def test_without_independence_there_are_estimates(flown: Path, tmp_path: Path) -> None:
    result = adopt_table(flown, asked(tmp_path, **plain_inputs(tmp_path), independent=False), tmp_path / "adopted")
    assert {entry.verdict for entry in result.manifest.requirements} == {"ESTIMATE"}


def test_units_of_the_heads_are_converted(flown: Path, tmp_path: Path) -> None:
    def in_metres(_: int, row: dict[str, str]) -> dict[str, str]:
        row["altitude_min [m]"] = repr(float(row.pop("altitude_min")) * 0.3048)
        row["system"] = row.pop("controller")
        row["delay [ms]"] = repr(1e3 * float(row.pop("delay")))
        return row

    adopt_table(rewritten(flown, in_metres), asked(tmp_path, **plain_inputs(tmp_path)), tmp_path / "adopted")
    ours, theirs = read_flown(tmp_path / "flown"), read_flown(tmp_path / "adopted")
    for name in ("v1", "v2"):
        assert theirs.flights[name].metrics["altitude_min"] == pytest.approx(ours.flights[name].metrics["altitude_min"])
    assert theirs.samples["delay"] == pytest.approx(ours.samples["delay"])
    pq.write_table(pc.read_csv(flown), tmp_path / "flights.parquet")
    adopt_table(tmp_path / "flights.parquet", asked(tmp_path, **plain_inputs(tmp_path)), tmp_path / "parquet")
    assert read_flown(tmp_path / "parquet").manifest.digest == ours.manifest.digest


@pytest.mark.parametrize(
    ("line", "changes", "words"),
    [
        (7, {"delay": "2.3"}, "delay 2.3, outside of its distribution"),
        (9, {"speed": "nan"}, "an input that is no number"),
        (11, {"outcome": "elsewhere"}, "outcome 'elsewhere'"),
        (13, {"controller": "v3"}, "system 'v3'|controller 'v3'"),
        (15, {"flight": "40"}, "another flight of 'v1'"),
        (330, {"speed": "561.0"}, "with other inputs than of another system"),
    ],
)
def test_a_row_that_makes_no_sense_is_refused_with_its_line(
    line: int, changes: dict[str, str], words: str, flown: Path, tmp_path: Path
) -> None:
    table = rewritten(flown, lambda i, row: {**row, **(changes if i == line else {})})
    with pytest.raises(InputError, match=words) as refused:
        adopt_table(table, asked(tmp_path, **plain_inputs(tmp_path)), tmp_path / "adopted")
    assert refused.value.line == line
    assert not (tmp_path / "adopted").exists()


def test_a_missing_column_and_a_flight_without_a_metric(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no column 'dive'"):
        adopt_table(flown, asked(tmp_path), tmp_path / "adopted")
    table = rewritten(flown, lambda i, row: {**row, **({"load": "nan", "outcome": "ok"} if i == 5 else {})})
    manifest = adopt_table(table, asked(tmp_path, **plain_inputs(tmp_path)), tmp_path / "adopted").manifest
    assert manifest.controllers["v1"].failed_to_run == (3,)
    assert manifest.complete


def test_nothing_flies_without_a_simulator(flown: Path, tmp_path: Path) -> None:
    campaign = asked(tmp_path, **plain_inputs(tmp_path), runs=300)
    with pytest.raises(InputError, match="adopt"):
        run_campaign(Request(campaign, tmp_path / "out"))
    adopted = adopt_table(flown, asked(tmp_path, **plain_inputs(tmp_path)), tmp_path / "adopted")
    assert adopted.complete
    with pytest.raises(InputError, match="a campaign that is flown by itself"):
        adopt_table(flown, dive_campaign(tmp_path / "own", DIVE, runs=300), tmp_path / "other")


def test_what_an_adopted_campaign_may_do_next_is_no_command(flown: Path, tmp_path: Path) -> None:
    requirement = {"metric": "altitude_min", "above": "-100000 ft", "probability": "99.5 %"}
    path = asked(tmp_path, **plain_inputs(tmp_path), requirements=[requirement])
    adopt_table(flown, path, tmp_path / "adopted")
    build_report(tmp_path / "adopted")
    judgement = json.loads((tmp_path / "adopted" / "report.json").read_text())["judgement"]
    assert judgement["met"] == "not shown"
    assert judgement["next"] is not None and judgement["next"]["command"] == ""
    assert "not asked" not in (tmp_path / "adopted" / "report.html").read_text()  # margins, which nobody could ask for


def test_what_is_said_of_adopted_flights_names_nothing_that_cannot_be_done(flown: Path, tmp_path: Path) -> None:
    out = tmp_path / "adopted"
    hard = [{"metric": "load", "below": 100.0, "probability": "99.5 %"}]
    table = rewritten(flown, lambda _, row: {**row, "outcome": "ok"})
    adopt_table(table, asked(tmp_path, **plain_inputs(tmp_path), requirements=hard), out)
    page = shown_text(build_report(out))
    report, manifest = (json.loads((out / name).read_text()) for name in ("report.json", "manifest.json"))
    judged = report["judgement"]
    assert judged["met"] == "not shown" and "larger table" in judged["next"]["why"] and not judged["next"]["command"]
    assert "--runs" not in json.dumps([report["verdicts"], manifest["requirements"]])
    for command in ("run", "explain", "replay"):
        assert f"abhv-mc {command}" not in page
    assert not re.search("[Cc]ontroller|Control usage|Bands over time|fly it again|seed 0", page)
    with pytest.raises(InputError, match="nothing can fly"):
        replay_flight(out, "v1", 0, make_engine().fly)


def test_two_adopted_folders_are_compared_and_stopped_at_a_gate(flown: Path, tmp_path: Path) -> None:
    campaign, folders = asked(tmp_path, **plain_inputs(tmp_path)), (tmp_path / "a", tmp_path / "b")
    lower = rewritten(flown, lambda _, row: {**row, "altitude_min": float(row["altitude_min"]) - 150.0})
    for table, out in zip((flown, lower), folders, strict=True):
        adopt_table(table, campaign, out)
    found = compare_folders(*folders, ("v1", "v1"), {"altitude_min": 0.05}, tmp_path / "compared")
    (pair,) = found.found.paired
    assert not pair.not_worse["altitude_min"].shown and pair.any_failure.only_b
    page = shown_text(tmp_path / "compared" / "report.html")
    assert "abhv-mc compare" in page and "abhv-mc replay" not in page and "abhv-mc explain" not in page
