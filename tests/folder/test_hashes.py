"""What is read of a folder is of one campaign, however long its reader takes."""

from dataclasses import replace

import pandas as pd
import pytest
from fake_flight import ENGINE, write_campaign
from report.synthetic import build_with

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.tables import open_database
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.build import is_up_to_date
from abhv_mc.results import open_results
from abhv_mc.topics import registry

CHANGED = "a run has written here meanwhile"


@pytest.fixture
def request_(tmp_path):
    keep = "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 5 Hz}}"
    campaign = write_campaign(tmp_path / "f", runs="60", keep=keep, execution="{batch: 15}")
    request = Request(campaign, tmp_path / "out")
    run_campaign(request, ENGINE)
    return request


@pytest.fixture
def fly_meanwhile(request_):
    """A run that takes the place of what a reader has begun to read."""
    return lambda *_: run_campaign(replace(request_, seed=99, fresh=True), ENGINE)


def test_a_query(request_, fly_meanwhile):
    def ask():
        with open_database(request_.out) as database:
            fly_meanwhile()
            return database.sql("select count(*) from samples, flights").fetchall()

    with pytest.raises(InputError, match=CHANGED):
        ask()


@pytest.mark.parametrize(
    "ask",
    [
        lambda results: results.samples,
        lambda results: results.query("select count(*) from flights"),
        lambda results: results.make_report(),
    ],
)
def test_a_notebook(request_, fly_meanwhile, monkeypatch, ask):
    """Flights of one campaign stood beside samples of the other, which drivers then came from."""
    monkeypatch.setattr("abhv_mc.simulators.engine.make_engine", lambda: ENGINE)
    results = open_results(request_.out)
    run_campaign(request_, ENGINE)  # with nothing to do: it disturbs nobody
    before = results.flights
    assert results.controllers == ("one", "two")
    fly_meanwhile()
    with pytest.raises(InputError, match=CHANGED):
        ask(results)
    pd.testing.assert_frame_equal(results.flights, before)


def test_a_report(request_, fly_meanwhile, monkeypatch):
    """It was 'up to date' ever after, with numbers of the campaign before."""
    build_with(request_.out)
    make_figures = registry.make_figures
    monkeypatch.setattr(registry, "make_figures", lambda *a: (fly_meanwhile(), make_figures(*a))[1])
    with pytest.raises(InputError, match=CHANGED):
        build_with(request_.out)
    monkeypatch.undo()
    assert not is_up_to_date(request_.out)
    build_with(request_.out)
    assert is_up_to_date(request_.out)
