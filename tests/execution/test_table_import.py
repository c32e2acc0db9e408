"""Import of flights that another simulator computed."""

import csv
import html
import json
import re
import signal
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from own_simulators import dive_campaign, shown_text
from programs import run_python

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.marginals import ContinuousMarginal, SometimesMarginal
from abhv_mc.check_inputs import check_inputs
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.table_import import _contradictions, import_tables, make_column
from abhv_mc.folder.flights import write_inputs
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.tables import export_csv
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.compare_page import compare_folders
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.requests import Request
from abhv_mc.statistics.table_checks import EqualRows, Level, PairCorrelation, TableFindings
from abhv_mc.topics.topic import Models
from abhv_mc_explore.counts import open_flights
from abhv_mc_explore.server import ExploreServer


def adopt_table(table, *arguments, **options):
    return import_tables([table], *arguments, **options)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Return the folder of 300 flights of two systems."""
    folder = tmp_path_factory.mktemp("own")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
        return run_campaign(
            Request(dive_campaign(folder / "own", runs=300), folder / "flown")
        ).folder


@pytest.fixture
def flown(campaign, tmp_path):
    """Return the exported table of the campaign."""
    return next(path for path in export_csv(campaign, tmp_path) if path.name == "flights.csv")


def make_campaign(tmp_path, without=("dive",), **changes):
    """Write the campaign of the import, without the input that is not dispersed or exported."""
    changes = {"simulator": None, "runs": None, "independent": True, **changes}
    inputs = json.loads(dive_campaign(tmp_path / "asked").read_text())["inputs"]
    changes["inputs"] = {name: entry for name, entry in inputs.items() if name not in without}
    return dive_campaign(tmp_path / "asked", **changes)


def rewritten(table, change):
    """Write the table with ``change`` applied to each row (a dictionary)."""
    with table.open(newline="") as file:
        rows = [change(i, row) for i, row in enumerate(csv.DictReader(file), 2)]
    path = table.with_name("changed.csv")
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def test_an_imported_table_gives_the_same_verdicts_comparison_and_rules(campaign, flown, tmp_path):
    result = adopt_table(flown, make_campaign(tmp_path), tmp_path / "adopted")
    ours, theirs = read_flown(campaign), read_flown(tmp_path / "adopted")
    assert result.complete
    assert theirs.manifest.requirements == ours.manifest.requirements
    assert theirs.manifest.digest == ours.manifest.digest
    first, second = (make_numbers(Models(results)) for results in (ours, theirs))
    for topic in ("verdicts", "comparison", "drivers", "metrics"):
        assert second[topic] == first[topic]
    assert second["failures"]["controllers"] == first["failures"]["controllers"]
    dependent = adopt_table(
        flown, make_campaign(tmp_path, independent=False), tmp_path / "dependent"
    ).manifest
    assert {entry.verdict for entry in dependent.requirements} == {"ESTIMATE"}


def test_a_campaign_is_valid_before_the_number_of_its_flights_is_known(tmp_path):
    (checked,) = check_inputs(make_campaign(tmp_path))
    assert (checked.kind, checked.warnings) == ("campaign", ())
    with pytest.raises(InputErrors, match="'runs'"):
        read_campaign(make_campaign(tmp_path))


def test_values_may_be_rounded_in_another_unit(flown, tmp_path):
    def rounded(_, row):
        return row | {"speed [m/s]": str(round(float(row.pop("speed")) * 0.3048, -1))}

    table = rewritten(flown, rounded)
    assert adopt_table(table, make_campaign(tmp_path), tmp_path / "adopted").complete


def test_units_of_the_heads_are_converted(campaign, flown, tmp_path):
    def in_metres(_, row):
        row["altitude_min [m]"] = repr(float(row.pop("altitude_min")) * 0.3048)
        row["system"] = row.pop("controller")
        row["delay [ms]"] = repr(1e3 * float(row.pop("delay")))
        return row

    adopt_table(rewritten(flown, in_metres), make_campaign(tmp_path), tmp_path / "adopted")
    ours, theirs = read_flown(campaign), read_flown(tmp_path / "adopted")
    for name in ("v1", "v2"):
        assert theirs.flights[name].metrics["altitude_min"] == pytest.approx(
            ours.flights[name].metrics["altitude_min"]
        )
    assert theirs.samples["delay"] == pytest.approx(ours.samples["delay"])
    pq.write_table(pc.read_csv(flown), tmp_path / "flights.parquet")
    adopt_table(tmp_path / "flights.parquet", make_campaign(tmp_path), tmp_path / "parquet")
    assert read_flown(tmp_path / "parquet").manifest.digest == ours.manifest.digest


@pytest.mark.parametrize(
    ("line", "changes", "pattern"),
    [
        (7, {"delay": "2.3"}, r"\b2\.3 of 'delay'"),
        (9, {"speed": "nan"}, r"\bspeed\b.*\bfinite\b"),
        (9, {"load": "high"}, r"'high'.*'load'"),
        (11, {"outcome": "elsewhere"}, "'elsewhere'"),
        (13, {"controller": "v3"}, "'v3'"),
        (43, {"flight": "13"}, r"\b13\b.*'v1'.*\btwice\b"),
        (301, {"flight": "1000"}, r"\b299\b.*'v1'"),
        (330, {"speed": "561.0"}, r"\b\d+\b.*\bdiffer"),
    ],
)
def test_an_invalid_row_is_rejected_with_its_line(line, changes, pattern, flown, tmp_path):
    lines = (line, line + 300) if "delay" in changes else (line,)  # the input of both systems
    table = rewritten(flown, lambda i, row: {**row, **(changes if i in lines else {})})
    with pytest.raises(InputError, match=pattern) as refused:
        adopt_table(table, make_campaign(tmp_path), tmp_path / "adopted")
    assert refused.value.line == line
    assert not (tmp_path / "adopted").exists()


def test_incompatible_tables_and_campaigns_are_rejected(flown, tmp_path):
    out, twice = tmp_path / "adopted", tmp_path / "twice.csv"
    twice.write_text(flown.read_text().replace("load", "altitude_min [m]", 1))
    flies = dive_campaign(tmp_path / "own", runs=300)
    less = tmp_path / "less.csv"
    less.write_text(flown.read_text().replace("speed", "velocity", 1))
    for pattern, call in (
        ("'speed'", lambda: adopt_table(less, make_campaign(tmp_path), out)),
        ("third", lambda: import_tables([flown] * 3, make_campaign(tmp_path), out)),
        ("'altitude_min'", lambda: adopt_table(twice, make_campaign(tmp_path), out)),
        (r"dive\.yaml:1:1: .*'inputs'", lambda: adopt_table(flown, flies, out)),
        ("import flights", lambda: run_campaign(Request(make_campaign(tmp_path, runs=300), out))),
    ):
        with pytest.raises(InputError, match=pattern):
            call()
    assert not out.exists()


def test_a_flight_without_a_metric_was_not_computed(flown, tmp_path):
    table = rewritten(
        flown, lambda i, row: {**row, **({"load": "nan", "outcome": "ok"} if i == 5 else {})}
    )
    manifest = adopt_table(table, make_campaign(tmp_path), tmp_path / "adopted").manifest
    assert manifest.controllers["v1"].failed_to_run == (3,) and manifest.complete


@pytest.mark.usefixtures("no_figures")
def test_texts_on_imported_flights_suggest_no_impossible_command(flown, tmp_path):
    out = tmp_path / "adopted"
    hard = [{"metric": "load", "below": 100.0, "probability": "99.5 %"}]
    table = rewritten(flown, lambda _, row: {**row, "outcome": "ok"})
    adopt_table(table, make_campaign(tmp_path, requirements=hard), out)
    page = shown_text(build_report(out))
    report, manifest = (
        json.loads((out / name).read_text()) for name in ("report.json", "manifest.json")
    )
    assert not list(verify_campaign(out))
    (following,) = report["summary"]["records"][-1]["entries"]
    assert "import" in following["text"] and "--runs" not in following["text"]
    assert "--runs" not in json.dumps([report["verdicts"], manifest["requirements"]])
    for command in ("run", "explain", "replay"):
        assert f"abhv-mc {command}" not in page
    assert not re.search("[Cc]ontroller|Control effort|Time histories|Reproduce this|seed 0", page)
    with open_flights(out) as table, ExploreServer(out, table) as server:
        opened = server.open_flight("v1", 0)
    assert opened["note"] == "" and opened["history"] is None and opened["values"]
    with pytest.raises(InputError, match=r":\d+:\d+: .*'simulator'"):
        replay_flight(out, "v1", 0)


def test_two_imported_folders_are_compared_and_fail_a_gate(flown, tmp_path):
    campaign, folders = make_campaign(tmp_path), (tmp_path / "a", tmp_path / "b")
    lower = rewritten(
        flown, lambda _, row: {**row, "altitude_min": float(row["altitude_min"]) - 150.0}
    )
    for table, out in zip((flown, lower), folders, strict=True):
        adopt_table(table, campaign, out)
    comparison = compare_folders(
        *folders, ("v1", "v1"), {"altitude_min": 0.05}, tmp_path / "compared"
    )
    (pair,) = comparison.found.paired
    assert not pair.not_worse["altitude_min"].shown and pair.any_failure.only_b
    page = shown_text(tmp_path / "compared" / "report.html")
    assert re.search(r"/a\s+imported\s+300", page)
    assert (
        "abhv-mc compare" in page and "abhv-mc replay" not in page and "abhv-mc explain" not in page
    )


def drawn_table(folder, change=None, digits=17):
    """Write a campaign of two inputs and a table of 60 draws, altered by ``change``."""
    content = {
        "name": "drawn",
        "independent": True,
        "inputs": {"a": {"unit": "m", "nominal": 10.0}, "b": {"unit": "m"}},
        "dispersions": {
            "a": {"distribution": "normal", "sigma": "1 m"},
            "b": {"distribution": "uniform", "half_width": "1.97 m"},
        },
        "metrics": {"miss": {"unit": "m"}},
        "requirements": [{"metric": "miss", "below": 15.0, "probability": "97 %"}],
    }
    draw = np.random.default_rng(31)
    values = np.column_stack([draw.normal(10.0, 1.0, 60), draw.uniform(-1.97, 1.97, 60)])
    values = values if change is None else change(values)
    campaign, table = folder / "drawn.yaml", folder / "drawn.csv"
    campaign.write_text(json.dumps(content))
    lines = [f"{a:.{digits}g},{b:.{digits}g},{a + b:.6g}" for a, b in values]
    table.write_text("\n".join(["a,b,miss", *lines, ""]))
    return table, campaign


def constant(values):
    return values * [1.0, 0.0]


def scaled(factor):
    return lambda values: [10.0, 0.0] + (values - [10.0, 0.0]) * [factor, 1.0]


def correlated(values):
    return np.column_stack([np.sort(values[:, 0]), np.sort(values[:, 1])])


def without_extremes():
    random = np.random.default_rng(5)
    a = random.normal(10.0, 1.0, 1100)
    a = a[abs(a - 10.0) < 2.0]
    return np.column_stack([a, random.uniform(-1.97, 1.97, a.size)])


def latin(values):
    order = np.argsort(np.argsort(values[:, 1]))
    return np.column_stack([values[:, 0], -1.97 + 3.94 * (order + 0.5) / len(values)])


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (lambda values: np.tile(values, (4, 1)), r":\d+: 360 "),
        (constant, r":1: .*'b' .* 1\.137, .* 0;"),
        (scaled(1 / 3), r":1: .*'a' .* 10 .* 1, .* 0\.2"),
        (scaled(3.0), r":1: .*'a' .*'independent: no'"),
        (correlated, r"'a'.*'b'"),
        (lambda _: without_extremes(), r"'a' has no value beyond \+2\.0 sigma"),
    ],
)
def test_a_table_that_holds_no_independent_draws_is_rejected(change, pattern, tmp_path):
    table, campaign = drawn_table(tmp_path, change)
    with pytest.raises(InputError, match=pattern):
        adopt_table(table, campaign, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    campaign.write_text(campaign.read_text().replace("true", "false"))
    (verdict,) = adopt_table(table, campaign, tmp_path / "out").manifest.requirements
    assert verdict.verdict == "ESTIMATE"


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(
    "change", [latin, lambda values: np.round(values * [0.0, 1.0] + [10.0, 0.0], 3)]
)
def test_a_design_and_a_constant_that_rounding_may_explain_get_estimates(change, tmp_path):
    out = tmp_path / "out"
    manifest = adopt_table(*drawn_table(tmp_path, change), out).manifest
    (verdict,), (warning,) = manifest.requirements, manifest.warnings
    assert verdict.verdict == "ESTIMATE" and re.match("'[ab]' ", warning)
    page = shown_text(build_report(out))
    assert warning in html.unescape(page) and read_flown(out).campaign.dependence in page
    assert not list(verify_campaign(out))
    again = adopt_table(*drawn_table(tmp_path, change), out)
    assert again.manifest == manifest


@pytest.mark.usefixtures("no_figures")
def test_a_rounded_table_of_draws_is_judged_and_its_moments_are_shown(tmp_path):
    out = tmp_path / "out"
    # 1.96 is rounded to 2, outside of its distribution.
    table, campaign = drawn_table(tmp_path, lambda v: np.vstack([[v[0, 0], 1.96], v[1:]]), digits=2)
    assert ",2," in table.read_text()
    (verdict,) = adopt_table(table, campaign, out).manifest.requirements
    assert verdict.verdict == "NOT SHOWN"
    page = build_report(out)
    inputs = json.loads((out / "report.json").read_text())["flights"]["inputs"]
    assert inputs["a"]["stated_mean"] == 10.0 and inputs["a"]["stated_sigma"] == 1.0
    assert inputs["b"]["stated_sigma"] == pytest.approx(1.97 / 3.0**0.5)
    columns = pc.read_csv(table)
    for name in ("a", "b"):
        assert inputs[name]["mean"] == pytest.approx(np.mean(columns[name].to_numpy()))
        assert inputs[name]["sigma"] == pytest.approx(np.std(columns[name].to_numpy()))
    row = re.search(r"Found spread\s+a\s+m\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)", shown_text(page))
    moments = [inputs["a"][key] for key in ("stated_mean", "mean", "stated_sigma", "sigma")]
    assert row and [float(cell) for cell in row.groups()] == pytest.approx(moments, rel=1e-3)


def test_a_column_has_the_probabilities_of_its_rounding_intervals_atoms_and_tails():
    """The law is 3 with a probability of 1/4, and otherwise uniform between 0 and 10."""
    drawn = ContinuousMarginal("uniform", (0.0, 10.0))
    law = SometimesMarginal(drawn, 0.75, 3.0)
    values, rounding = np.array([2.0, 3.0, 6.5, 7.5]), np.array([0.5, 0.0, 0.1, 0.8])
    column = make_column(law, values, rounding)
    assert column.low == pytest.approx([0.1125, 0.225, 0.73, 0.7525])
    assert column.high == pytest.approx([0.1875, 0.475, 0.745, 0.8725])
    assert column.atoms.tolist() == [3.0] and column.shares == pytest.approx([0.25])
    assert column.tails == pytest.approx((0.075, 0.0675))  # below 2 - 1, and above 7.5 + 1.6
    assert column.values is values and column.half_step is rounding


def test_stated_correlations_are_those_of_the_table(tmp_path):
    def mixed(values):
        order = np.argsort(values[:, 0] + np.random.default_rng(1).normal(0.0, 0.5, 60))
        values[order, 1] = np.sort(values[:, 1])
        return values

    table, campaign = drawn_table(tmp_path, mixed)
    with pytest.raises(InputError, match=r"'a'.*'b'.*'correlations'"):
        adopt_table(table, campaign, tmp_path / "out")
    content = json.loads(campaign.read_text())
    content["correlations"] = [{"between": ["a", "b"], "rank": 0.88}]
    campaign.write_text(json.dumps(content))
    adopt_table(table, campaign, tmp_path / "out")
    content["correlations"][0]["rank"] = -0.88
    campaign.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"-0\.88"):
        adopt_table(table, campaign, tmp_path / "other")


@pytest.mark.parametrize("separator", ["\t", ","])
def test_thousands_are_read_by_the_distribution_of_an_input_or_by_a_key(separator, tmp_path):
    table, campaign = drawn_table(tmp_path)
    content = json.loads(campaign.read_text())
    content["inputs"]["a"]["nominal"], content["dispersions"]["a"]["sigma"] = 10e3, "1000 m"
    random = np.random.default_rng(1)
    values = np.round([random.normal(10e3, 1e3, 60), 2.0 - 4.0 * random.random(60)]).astype(int)

    def misses(form, **keys):
        rows = [(form.format(a), str(b), f"{a + 2000:,}") for a, b in values.T]
        body = "".join('"' + f'"{separator}"'.join(row) + '"\n' for row in rows)
        table.write_text(separator.join(["a", "b", "miss"]) + "\n" + body)
        campaign.write_text(json.dumps({**content, **keys}))
        adopt_table(table, campaign, tmp_path / "out", fresh=True)
        return read_flown(tmp_path / "out").flights["system"].metrics["miss"].tolist()

    expected = [float(a + 2000) for a in values[0]]
    assert misses("{:,}") == misses("{}", thousands=",") == expected
    assert misses("{}", decimal=",") == [miss / 1e3 for miss in expected]
    with pytest.raises(InputError, match=r"decimal: .*thousands: "):
        misses("{}")


@pytest.mark.parametrize(
    ("rows", "first", "keys"),
    [
        (slice(60), 1, {}),  # 1 to n
        (slice(59), 1, None),
        (slice(1, 60), 0, None),
        (slice(40), 1, {"first_flight": 1}),
        (slice(1, 40), 0, {"first_flight": 0}),
        (slice(40), 1, {"b": 1}),  # with repeated inputs
        (slice(1, 40), 0, {"b": 1}),
    ],
)
def test_flights_numbered_from_1_get_their_own_inputs(rows, first, keys, tmp_path):
    campaign, inputs, results = written_inputs(tmp_path)
    lines = [f"{i + first},{m},{drawn_b(inputs, i)}" for i, (_, m) in enumerate(results)][rows]
    table, repeated = tmp_path / "results.csv", "b" if keys and keys.pop("b", 0) else "unused"
    table.write_text("\n".join([f"flight,miss,{repeated}", *lines, ""]))
    campaign.write_text(json.dumps({**json.loads(campaign.read_text()), **(keys or {})}))
    if keys is None:
        with pytest.raises(InputError, match="'first_flight: 0' or 'first_flight: 1'"):
            import_tables([inputs, table], campaign, tmp_path / "out")
        return
    manifest = import_tables([inputs, table], campaign, tmp_path / "out").manifest
    assert sum("results.csv" in text for text in manifest.warnings) == (first == 1 and not keys)
    flown = read_flown(tmp_path / "out")
    expected = (flown.samples["a"] + flown.samples["b"])[rows]
    assert flown.flights["system"].metrics["miss"] == pytest.approx(expected)


@pytest.mark.usefixtures("no_figures")
def test_a_table_without_a_last_line_end_or_with_words_as_lengths(tmp_path):
    table, campaign = drawn_table(tmp_path)
    campaign.write_text(json.dumps({**json.loads(campaign.read_text()), "runs": 90}))
    text = table.read_text()
    table.write_text(text.rstrip())
    out = tmp_path / "out"
    assert "drawn.csv" in adopt_table(table, campaign, out).manifest.warnings[0]
    assert "abhv-mc run" not in shown_text(build_report(out))
    for word in ("true", "False"):
        table.write_text(f"{text.rpartition(',')[0]},{word}\n")
        with pytest.raises(InputError, match=f"'{word}'") as caught:
            adopt_table(table, campaign, out)
        assert caught.value.line == 61


def written_inputs(folder, runs=60):
    """Write a campaign and the table of its inputs; return rows of results: flight, a + b."""
    _, campaign = drawn_table(folder)
    content = json.loads(campaign.read_text())
    content["inputs"]["noise"], content["inputs"]["gain"] = {"seed": True}, {"nominal": 2.0}
    campaign.write_text(json.dumps(content))
    inputs = folder / "inputs.csv"
    assert write_inputs(read_campaign(campaign, runs), inputs) == runs
    rows = list(csv.DictReader(inputs.read_text().splitlines()))
    assert list(rows[0]) == ["flight", "a [m]", "b [m]", "noise"] and len(rows) == runs
    return (
        campaign,
        inputs,
        [[r["flight"], repr(float(r["a [m]"]) + float(r["b [m]"]))] for r in rows],
    )


def test_written_inputs_are_paired_with_results_by_flight(tmp_path):
    campaign, inputs, results = written_inputs(tmp_path)
    table = tmp_path / "results.csv"
    # In order of completion; flight 0 did not run.
    lines = [f"{flight};{miss.replace('.', ',')}" for flight, miss in reversed(results[1:])]
    table.write_text("\n".join(["case;miss (m)", *lines, ""]))
    content = {**json.loads(campaign.read_text()), "columns": {"flight": "case"}}
    content["first_flight"] = 0
    with pytest.raises(InputError, match=r"'a'.*'columns'"):
        import_tables([table], campaign, tmp_path / "out")
    with pytest.raises(InputError, match="'flight'"):
        import_tables([inputs, table], campaign, tmp_path / "out")
    inputs.write_text(inputs.read_text().replace("flight", "case", 1))
    campaign.write_text(json.dumps(content))
    for order in ([inputs, table], [table, inputs]):
        result = import_tables(order, campaign, tmp_path / "out")
        assert result.manifest.controllers["system"].failed_to_run == (0,)
        flown = read_flown(tmp_path / "out")
        assert flown.flights["system"].metrics["miss"].tolist() == [
            float(m) for _, m in results[1:]
        ]
        drawn = read_campaign(campaign, 60).make_samples().draw(0, 60)
        assert flown.samples["a"].tolist() == drawn[:, 0].tolist()
        assert flown.samples["noise"].tolist() == drawn[:, 2].tolist()
        assert set(flown.samples["gain"].tolist()) == {2.0}


@pytest.mark.parametrize(
    ("row", "pattern"),
    [
        ("60,1,0", r"\b60\b.*inputs\.csv"),
        ("7,1,-99", r"'b' is -99\b.*inputs\.csv"),
        ("8,1,0", r"\b8\b.*'system'.*\btwice\b"),
    ],
)
def test_a_result_without_inputs_is_rejected(row, pattern, tmp_path):
    campaign, inputs, _ = written_inputs(tmp_path)
    (tmp_path / "results.csv").write_text(f"flight,miss,b\n8,1,{drawn_b(inputs, 8)}\n{row}\n")
    with pytest.raises(InputError, match=pattern) as caught:
        import_tables([inputs, tmp_path / "results.csv"], campaign, tmp_path / "out")
    assert caught.value.line == 3


@pytest.mark.parametrize(("share", "is_same"), [(-0.99e-4, True), (-1.01e-4, False)])
def test_repeated_inputs_agree_to_a_share_of_the_largest(share, is_same, tmp_path):
    campaign, inputs, results = written_inputs(tmp_path)
    b = [float(line.split(",")[2]) for line in inputs.read_text().splitlines()[1:]]
    b[7] += share * max(map(abs, b))
    table = tmp_path / "results.csv"
    lines = [f"{i},{miss},{b[i]!r}" for i, (_, miss) in enumerate(results)]
    table.write_text("\n".join(["flight,miss,b", *lines, ""]))
    with nullcontext() if is_same else pytest.raises(InputError, match=r":9:\d+: 'b' is"):
        import_tables([inputs, table], campaign, tmp_path / "out")


def drawn_b(inputs, flight):
    """Return an input with an error of almost 1e-4 of the largest, 1.97."""
    return f"{float(inputs.read_text().splitlines()[flight + 1].split(',')[2]) + 1.5e-4:.6f}"


FOREIGN = {
    "units row": "a,b,miss\nm,m,km\n{rows}",
    "brackets": "a (m),b {{m}},miss [km],x[0],x[1]\n{rows}",
    "numbered from 1": "number,a,b,miss_km\n{rows}",
    "unit after a slash": "a / m,b in m,Ablage / km\n{rows}",
    "unit in the name of a column": "a,b,Ablage_km\n{rows}",
    "JSON Lines": "{rows}",
    "tabular file of Dakota": "%eval_id interface a b response_fn_1\n{rows}",
}


@pytest.mark.parametrize("dialect", FOREIGN)
def test_foreign_dialects_give_the_same_verdicts(dialect, tmp_path):
    table, campaign = drawn_table(tmp_path, digits=6)
    expected = adopt_table(table, campaign, tmp_path / "plain").manifest
    content = {**json.loads(campaign.read_text()), "columns": {}}
    rows = [line.split(",") for line in table.read_text().splitlines()[1:]]
    if "JSON" in dialect:
        content["columns"] |= {"miss": "out.miss [km]", "a": "in.a"}
        lines = [
            json.dumps({"in": {"a": float(a)}, "b": float(b), "out": {"miss": float(miss) / 1e3}})
            for a, b, miss in rows
        ]
    else:
        lines = [f"{a},{b},{float(miss) / 1e3!r}" for a, b, miss in rows]
        if "brackets" in dialect:
            lines = [f"{line},,text" for line in lines]
        if "Dakota" in dialect:
            content["columns"] = {"flight": "eval_id", "miss": "response_fn_1 [km]"}
            lines = [f"{i} NO_ID {line.replace(',', ' ')}" for i, line in enumerate(lines, 1)]
        if "unit " in dialect:
            content["columns"] = {"miss": FOREIGN[dialect].split("\n")[0].split(",")[2]}
        if "numbered" in dialect:
            content["columns"] = {"flight": "number"}
            lines = [f"{i},{line}" for i, line in enumerate(lines, 1)][::-1]
    (tmp_path / "foreign.txt").write_text(FOREIGN[dialect].format(rows="\n".join(lines)))
    campaign.write_text(json.dumps(content))
    manifest = adopt_table(tmp_path / "foreign.txt", campaign, tmp_path / "foreign").manifest
    assert [item.words for item in manifest.requirements] == [
        item.words for item in expected.requirements
    ]
    ours, theirs = read_flown(tmp_path / "plain"), read_flown(tmp_path / "foreign")
    assert np.array_equal(ours.samples["a"], theirs.samples["a"])
    metrics = [results.flights["system"].metrics["miss"] for results in (ours, theirs)]
    assert metrics[1] == pytest.approx(metrics[0], rel=1e-12)


def test_columns_name_inputs_and_metrics_of_a_table(tmp_path):
    table, campaign = drawn_table(tmp_path)
    content = json.loads(campaign.read_text())
    for columns, pattern in (
        ({"mis": "x"}, r"'mis'.*'miss'"),
        ({"miss": "x"}, "'x'"),
        ({"outcome": "y"}, "'y'"),
    ):
        campaign.write_text(json.dumps({**content, "columns": columns}))
        with pytest.raises(InputError, match=pattern):
            adopt_table(table, campaign, tmp_path / "out")


def test_a_repeated_import_ends_as_the_first_and_another_table_is_rejected(tmp_path):
    out = tmp_path / "out"
    table, campaign = drawn_table(tmp_path)
    first = adopt_table(table, campaign, out)
    files = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert adopt_table(table, campaign, out).manifest == first.manifest
    contents = {path: path.read_bytes() for path in files if path.name != ".lock"}
    assert contents.items() <= files.items()
    (block,) = (out / "flights").iterdir()
    block.write_bytes(b"damaged")
    assert adopt_table(table, campaign, out).manifest.digest == first.manifest.digest
    assert block.read_bytes() == files[block]
    text = table.read_text()
    for change, pattern in (
        (
            lambda: table.write_text(text.replace(text.split(",")[-1].strip(), "14.9")),
            "--fresh",
        ),
        (lambda: drawn_table(tmp_path, lambda values: values[::-1]), r"\bsamples: "),
        (lambda: drawn_table(tmp_path, lambda values: values[:59]), "runs: 60 -> 59"),
    ):
        change()
        with pytest.raises(InputError, match=pattern):
            adopt_table(table, campaign, out)
    assert adopt_table(table, campaign, out, fresh=True).manifest.runs_done == 59


_KILLED = """
import os, signal, sys
from pathlib import Path
from abhv_mc.execution import flight_tables, table_import
from abhv_mc.folder import layout

left, flight_tables._ROWS = int(sys.argv[4]), 25

def killed(*_):
    global left
    left -= 1
    if not left:
        os.kill(os.getpid(), signal.SIGKILL)

layout.atomic_write = (lambda put: lambda *of: (killed(), put(*of))[1])(layout.atomic_write)
with layout.recording(killed):
    table, *others = map(Path, sys.argv[1:4])
result = table_import.import_tables([table], *others)
print(result.manifest.state, result.manifest.digest)
"""


@pytest.mark.thorough
def test_an_import_killed_at_any_file_resumes_to_the_same_digest(tmp_path):
    table, campaign = drawn_table(tmp_path)
    pq.write_table(pc.read_csv(table), parquet := tmp_path / "drawn.parquet")
    expected = adopt_table(table, campaign, tmp_path / "once").manifest

    program, files = ("-c", _KILLED, parquet, campaign), 1
    while (
        killed := run_python(*program, out := tmp_path / f"{files}", files)
    ).returncode == -signal.SIGKILL:
        ended = run_python(*program, out, 0)
        assert ended.stdout.split() == ["complete", expected.digest], ended.stderr
        files += 1
    assert killed.returncode == 0 and files > 6, killed.stderr


@pytest.mark.parametrize("key", ["line", "index"])
def test_rows_of_two_tables_are_paired_by_line_on_request_or_by_index(key, tmp_path):
    """RocketPy writes a line to each of two files when a simulation ends, without its number.

    Regression: results with indices got the inputs of other flights, as simulations end in any
    order.
    """
    campaign, inputs, results = written_inputs(tmp_path)
    drawn = read_campaign(campaign, 60).make_samples().draw(0, 60)
    rows = list(csv.DictReader(inputs.read_text().splitlines()))
    lines = [{name.split()[0]: float(row[name]) for name in list(row)[1:]} for row in rows]
    ended = [{"miss": float(miss)} for _, miss in results]
    if key == "index":
        lines, ended = ([{"index": i} | row for i, row in enumerate(t)] for t in (lines, ended))
        ended.reverse()
    inputs.write_text("".join(json.dumps(line) + "\n" for line in lines))
    table, content = tmp_path / "results.txt", json.loads(campaign.read_text())
    table.write_text("".join(json.dumps(row) + "\n" for row in ended))
    for columns in ({}, {"flight": "line"})[: 1 + (key == "index")]:
        campaign.write_text(json.dumps({**content, "columns": columns}))
        with pytest.raises(InputError, match=f"flight: {key}"):
            import_tables([inputs, table], campaign, tmp_path / "out")
    campaign.write_text(json.dumps({**content, "columns": {"flight": key}}))
    import_tables([inputs, table], campaign, tmp_path / "out")
    flown = read_flown(tmp_path / "out")
    assert flown.samples["a"].tolist() == drawn[:, 0].tolist()
    assert flown.flights["system"].metrics["miss"].tolist() == [float(m) for _, m in results]
    if key == "line":
        table.write_text("".join(json.dumps(row) + "\n" for row in ended[1:]))
        with pytest.raises(InputError, match=r"59 rows.*60"):
            import_tables([inputs, table], campaign, tmp_path / "other")


def test_contradictions_state_the_numbers_of_the_table_and_of_the_campaign():
    """Columns are normal with mean 10 and sigma 2; line numbers are those of the table."""
    marginals = dict.fromkeys("abcd", ContinuousMarginal("norm", (10.0, 2.0)))
    parameters = dict.fromkeys("abcd", SimpleNamespace(unit="m"))
    campaign = SimpleNamespace(marginals=marginals, parameters=parameters)
    values = np.array([6.0, 7.0, 9.0, 17.0])
    columns = [SimpleNamespace(values=values + k) for k in range(4)]
    findings = TableFindings(
        too_far=(2,),
        levels=(Level(0, 7.0, 3, 0.125), Level(0, 8.0, 2, 0.25)),
        correlations=(PairCorrelation((1, 3), 0.75, -0.5),),
        equal=EqualRows(6, 0.02, (2, 3)),
        too_close=(),
        constant=(),
        missing=((1, 0), (3, 1)),
    )
    lines = np.array([2, 4, 6, 9])
    found = [*_contradictions(findings, campaign, columns, lines)]
    numbers = [re.findall(r"[+-]?\d[\d.]*", problem.replace("'", "")) for problem, *_ in found]
    spread = f"{values.std():.4g}"
    assert numbers == [
        ["10", "2", "9.75", spread, "7", "3", "4", "12.5"],
        ["10", "2", "11.75", spread],
        ["-1.5"],  # the smallest of `b` is 7, the largest of `d` is 20
        ["+5.0"],
        ["0.75", "-0.5"],
        ["6", "6", "9", "0.02"],
    ]
    assert [line for *_, line in found] == [1] * 5 + [9]
    names = [re.findall(r"'([a-d])'", problem) for problem, *_ in found]
    assert names == [["a"], ["c"], ["b"], ["d"], ["b", "d"], []]
    few = findings._replace(equal=EqualRows(1, 0.01, (0, 1)), levels=(), too_far=(), missing=())
    *_, (problem, _, line) = _contradictions(few, campaign, columns, lines)
    assert line == 4 and "explains none" in problem
