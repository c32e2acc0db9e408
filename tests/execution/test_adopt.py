"""Flights that somebody else has flown, in a table."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from own_simulators import dive_campaign, shown_text

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.adopt import adopt_table
from abhv_mc.execution.runner import run_campaign
from abhv_mc.flight.outcome import OUTCOMES
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.samples import SampleReader
from abhv_mc.folder.tables import export_csv
from abhv_mc.io.input_error import InputError
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.compare_page import compare_folders
from abhv_mc.report.pages.verify import differences, verify_campaign
from abhv_mc.requests import Request
from abhv_mc.shipped import shipped_folder
from abhv_mc.simulators.engine import make_engine
from abhv_mc.topics.failures import FAILURES
from abhv_mc.topics.plain import plain
from abhv_mc.topics.topic import Models
from abhv_mc_explore.counts import open_flights
from abhv_mc_explore.server import ExploreServer


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of 300 flights of two systems."""
    folder = tmp_path_factory.mktemp("own")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
        return run_campaign(
            Request(dive_campaign(folder / "own", runs=300), folder / "flown")
        ).folder


@pytest.fixture
def flown(campaign: Path, tmp_path: Path) -> Path:
    """Its exported table."""
    return next(path for path in export_csv(campaign, tmp_path) if path.name == "flights.csv")


def asked(tmp_path: Path, without: tuple[str, ...] = ("dive",), **changes: Any) -> Path:
    """The campaign that adopts it, without the input that nothing disperses: the export has no column of it."""
    changes = {"simulator": None, "runs": None, "independent": True, **changes}
    inputs = json.loads(dive_campaign(tmp_path / "asked").read_text())["inputs"]
    changes["inputs"] = {name: entry for name, entry in inputs.items() if name not in without}
    return dive_campaign(tmp_path / "asked", **changes)


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


def test_an_adopted_table_gives_the_same_verdicts_comparison_and_rules(
    campaign: Path, flown: Path, tmp_path: Path
) -> None:
    result = adopt_table(flown, asked(tmp_path), tmp_path / "adopted")
    ours, theirs = read_flown(campaign), read_flown(tmp_path / "adopted")
    assert result.complete
    assert theirs.manifest.requirements == ours.manifest.requirements
    assert theirs.manifest.digest == ours.manifest.digest
    first, second = (make_numbers(Models(results)) for results in (ours, theirs))
    for topic in ("verdicts", "comparison", "drivers", "metrics"):
        assert second[topic] == first[topic]
    assert second["failures"]["controllers"] == first["failures"]["controllers"]
    dependent = adopt_table(
        flown, asked(tmp_path, independent=False), tmp_path / "dependent"
    ).manifest
    assert {entry.verdict for entry in dependent.requirements} == {"ESTIMATE"}


def test_units_of_the_heads_are_converted(campaign: Path, flown: Path, tmp_path: Path) -> None:
    def in_metres(_: int, row: dict[str, str]) -> dict[str, str]:
        row["altitude_min [m]"] = repr(float(row.pop("altitude_min")) * 0.3048)
        row["system"] = row.pop("controller")
        row["delay [ms]"] = repr(1e3 * float(row.pop("delay")))
        return row

    adopt_table(rewritten(flown, in_metres), asked(tmp_path), tmp_path / "adopted")
    ours, theirs = read_flown(campaign), read_flown(tmp_path / "adopted")
    for name in ("v1", "v2"):
        assert theirs.flights[name].metrics["altitude_min"] == pytest.approx(
            ours.flights[name].metrics["altitude_min"]
        )
    assert theirs.samples["delay"] == pytest.approx(ours.samples["delay"])
    pq.write_table(pc.read_csv(flown), tmp_path / "flights.parquet")
    adopt_table(tmp_path / "flights.parquet", asked(tmp_path), tmp_path / "parquet")
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
        adopt_table(table, asked(tmp_path), tmp_path / "adopted")
    assert refused.value.line == line
    assert not (tmp_path / "adopted").exists()


def test_tables_and_campaigns_that_do_not_fit_are_refused(flown: Path, tmp_path: Path) -> None:
    out, twice = tmp_path / "adopted", tmp_path / "twice.csv"
    twice.write_text(flown.read_text().replace("load", "altitude_min [m]", 1))
    flies = dive_campaign(tmp_path / "own", runs=300)
    for words, ask in (
        ("no column 'dive'", lambda: adopt_table(flown, asked(tmp_path, without=()), out)),
        ("2 columns 'altitude_min'", lambda: adopt_table(twice, asked(tmp_path), out)),
        ("a campaign that is flown by itself", lambda: adopt_table(flown, flies, out)),
        ("adopt", lambda: run_campaign(Request(asked(tmp_path, runs=300), out))),
    ):
        with pytest.raises(InputError, match=words):
            ask()
    assert not out.exists()


def test_a_flight_without_a_metric_was_not_computed(flown: Path, tmp_path: Path) -> None:
    table = rewritten(
        flown, lambda i, row: {**row, **({"load": "nan", "outcome": "ok"} if i == 5 else {})}
    )
    manifest = adopt_table(table, asked(tmp_path), tmp_path / "adopted").manifest
    assert manifest.controllers["v1"].failed_to_run == (3,) and manifest.complete


@pytest.mark.usefixtures("no_figures")
def test_what_is_said_of_adopted_flights_names_nothing_that_cannot_be_done(
    flown: Path, tmp_path: Path
) -> None:
    out = tmp_path / "adopted"
    hard = [{"metric": "load", "below": 100.0, "probability": "99.5 %"}]
    table = rewritten(flown, lambda _, row: {**row, "outcome": "ok"})
    adopt_table(table, asked(tmp_path, requirements=hard), out)
    page = shown_text(build_report(out))
    report, manifest = (
        json.loads((out / name).read_text()) for name in ("report.json", "manifest.json")
    )
    judged = report["judgement"]
    assert not list(verify_campaign(out))
    assert (
        judged["met"] == "not shown"
        and "larger table" in judged["next"]["why"]
        and not judged["next"]["command"]
    )
    assert "--runs" not in json.dumps([report["verdicts"], manifest["requirements"]])
    for command in ("run", "explain", "replay"):
        assert f"abhv-mc {command}" not in page
    assert not re.search("[Cc]ontroller|Control usage|Bands over time|fly it again|seed 0", page)
    with open_flights(out) as table, ExploreServer(out, table, make_engine()) as server:
        opened = server.open_flight("v1", 0)
    assert opened["note"] == "" and opened["history"] is None and opened["values"]
    with pytest.raises(InputError, match="nothing can fly"):
        replay_flight(out, "v1", 0, make_engine().fly)


def test_two_adopted_folders_are_compared_and_stopped_at_a_gate(
    flown: Path, tmp_path: Path
) -> None:
    campaign, folders = asked(tmp_path), (tmp_path / "a", tmp_path / "b")
    lower = rewritten(
        flown, lambda _, row: {**row, "altitude_min": float(row["altitude_min"]) - 150.0}
    )
    for table, out in zip((flown, lower), folders, strict=True):
        adopt_table(table, campaign, out)
    found = compare_folders(*folders, ("v1", "v1"), {"altitude_min": 0.05}, tmp_path / "compared")
    (pair,) = found.found.paired
    assert not pair.not_worse["altitude_min"].shown and pair.any_failure.only_b
    page = shown_text(tmp_path / "compared" / "report.html")
    assert re.search(r"/a\s+adopted\s+300", page)
    assert (
        "abhv-mc compare" in page and "abhv-mc replay" not in page and "abhv-mc explain" not in page
    )


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["s_manoeuvre", "wide"])
def test_our_own_flights_adopted_by_a_campaign_that_knows_no_vehicle_say_the_same(
    name: str, tmp_path: Path
) -> None:
    path = shipped_folder() / "campaigns" / f"{name}.yaml"
    ours = run_campaign(Request(path, tmp_path / "ours", runs=48, workers=2)).manifest
    campaign, table = read_campaign(path, runs=48), tmp_path / "flights.csv"
    assert table in set(export_csv(tmp_path / "ours", tmp_path))
    flown = SampleReader(tmp_path / "ours" / "samples.parquet").names
    records = [campaign.parameters[each] for each in flown]
    required = dict.fromkeys(item.metric for item in campaign.requirements)
    entries = campaign.document.data["requirements"]  # type: ignore[call-overload,index]
    content = {
        "name": name,
        "independent": True,
        "systems": {each: {} for each in campaign.controllers},
        "inputs": {r.name: {"unit": r.unit, "nominal": r.nominal, "seed": r.seed} for r in records},
        "dispersions": {
            key: law
            for key, law in campaign.dispersions.items()
            if not campaign.parameters[key].seed
        },
        "metrics": {
            each: {key: getattr(campaign.metrics[each], key) for key in ("unit", "label", "doc")}
            for each in required
        },
        "outcomes": {
            code: words
            for code, words in OUTCOMES.sentences.items()
            if code not in ("ok", "failed_to_run")
        },
        "requirements": entries,
    }
    (tmp_path / "adopted.yaml").write_text(json.dumps(content))
    adopted = adopt_table(table, tmp_path / "adopted.yaml", tmp_path / "adopted").manifest
    for ours_or_shown in ("requirements", "requirements_shown"):
        found, expected = ([(each.verdict, each.failures, each.flights) for each in getattr(manifest, ours_or_shown)]
                           for manifest in (adopted, ours))  # fmt: skip
        assert found == expected
    one, two = (
        plain(Models(read_flown(tmp_path / folder))[FAILURES]) for folder in ("ours", "adopted")
    )
    advice = (
        "words",
        "advice",
    )  # how a verdict would stand with more flights, which nothing here can fly
    assert not [
        d for d in differences(one, two) if d.partition(":")[0].rpartition(".")[2] not in advice
    ]
