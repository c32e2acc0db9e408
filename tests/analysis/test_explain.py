"""Failing flights of a fake campaign are explained by what makes the fake flight fail."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, LOST_BELOW, fly, run, write_campaign

from abhv_mc.analysis.explain import explain_flight, mildest_first
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.io.documents import InputError

LIMIT = 4.9


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explain")
    requirements = f"[{{metric: altitude_error_max_m, below: {LIMIT}, probability: 0.9, ended_early: as_measured}}]"
    run(write_campaign(folder / "f", requirements=requirements), folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def table(flown):
    return pq.read_table(flown / "flights").to_pandas().query("controller == 'two'").set_index("flight")


def test_an_early_end_is_explained_by_the_density(flown, table):
    flight = int(table.query("outcome != 'ok'").index[0])
    found = explain_flight(flown, "two", flight, fly)
    assert found.causes == ("atmosphere.density",) and found.smallest and not found.others
    assert found.failure.words == "ended early" and found.samples["atmosphere.density"] < LOST_BELOW
    nominal, alone, whole = (dict(zip(found.samples, row, strict=True)) for row in found.rows)
    assert alone == nominal | {"atmosphere.density": whole["atmosphere.density"]} and whole == found.samples
    assert found.block.history.shape[0] == 3 and list(found.block.outcome) == [0, 3, 3]


def test_a_missed_requirement_is_explained_by_what_it_takes(flown, table):
    missed = table.query("outcome == 'ok' and altitude_error_max_m >= @LIMIT")
    sizes = set()
    for flight in missed.index[:30]:
        found = explain_flight(flown, "two", int(flight), fly, "altitude_error_max_m")
        alone = found.block.metrics[1, METRIC_INDEX["altitude_error_max_m"]]
        assert alone >= LIMIT > found.block.metrics[0, METRIC_INDEX["altitude_error_max_m"]]
        sizes.add(len(found.causes))
    assert sizes == {1, 2}


def test_an_unknown_is_a_cause_like_a_dispersion(tmp_path):
    """It said 'the nominal flight fails, too', of a flight at a point where all others are lost."""
    entries = {
        "unknowns": "{atmosphere.density: {low: 0.88, high: 1.1}}",
        "dispersions": "{aero.lift: {distribution: normal, sigma: 5 %}}",
    }
    folder = run(write_campaign(tmp_path / "f", runs="5", **entries), tmp_path / "out").folder
    flights = pq.read_table(folder / "flights").to_pandas().query("controller == 'two' and outcome != 'ok'")
    found = explain_flight(folder, "two", int(flights["flight"].iloc[0]), fly)
    assert found.causes == ("atmosphere.density",) and found.samples["atmosphere.density"] < LOST_BELOW
    assert list(found.block.outcome) == [0, 3, 3]


def test_what_cannot_be_explained_is_refused(flown, table):
    good = int(table.query("outcome == 'ok' and altitude_error_max_m < @LIMIT").index[0])
    lost = int(table.query("outcome != 'ok'").index[0])
    for words, arguments in {
        "did not fail": ("two", good),
        "no flight 300": ("two", 300),
        "no controller 'three'": ("three", 1),
        "no controller '/x'": ("/x", 1),  # no path of a plan
        "no requirement on 'bank_deg'": ("two", lost, fly, "bank_deg"),
    }.items():
        name, flight, *rest = arguments
        with pytest.raises(InputError, match=words):
            explain_flight(flown, name, flight, *(rest or [fly]))

    def tame(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        return replace(block, outcome=np.zeros_like(block.outcome))

    with pytest.raises(InputError, match="does not fail when flown again"):
        explain_flight(flown, "two", lost, tame)


def test_the_command_prints_the_causes_and_draws_the_flight(flown, table, tmp_path, monkeypatch, capsys):
    from typer.testing import CliRunner

    from abhv_mc.cli.app import app

    monkeypatch.setattr("abhv_mc.simulators.engine.make_engine", lambda: ENGINE)
    flight = int(table.query("outcome != 'ok'").index[0])
    shown = CliRunner().invoke(app, ["explain", str(flown), "--flight", str(flight), "--controller", "two"])
    assert shown.exit_code == 0, shown.exception
    assert "1 of its 2 dispersions alone (no smaller set does" in shown.stdout
    assert (flown / f"explained/two-{flight}.png").stat().st_size > 10_000
    told = CliRunner().invoke(
        app, ["explain", str(flown), "--flight", str(flight), "--json", "-", "-o", str(tmp_path / "x.png")]
    )
    numbers = json.loads(told.stdout)
    assert numbers["controller"] == "one" and list(numbers["causes"]) == ["atmosphere.density"]
    assert (tmp_path / "x.png").is_file()


def test_a_failure_that_seldom_comes_is_no_usual_dispersion():
    """It was the most usual one where most flights are without it, with a warning of numpy's."""
    drawn = np.column_stack([np.where(np.arange(100) % 10, np.inf, 5.0), np.linspace(-1.0, 1.0, 100)])
    samples = SimpleNamespace(flights=100, rows=lambda first, stop: drawn[first:stop])
    with np.errstate(all="raise"):
        assert mildest_first(samples, np.array([5.0, 0.8])).tolist() == [1, 0]
        assert mildest_first(samples, np.array([np.inf, 0.8])).tolist() == [0, 1]
