"""Flights simulated in memory equal those of a campaign with the same samples."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fake_flight import ENGINE, run, write_campaign

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import System
from abhv_mc.execution import executor
from abhv_mc.execution.executor import connect, simulate, simulate_table
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX

HEIGHT = "altitude_m"


def draw(experiment, flights):
    source = experiment.make_samples()
    return pd.DataFrame(source.draw(0, flights), columns=list(source.names))


def test_a_table_of_samples_gives_the_campaigns_flights_to_the_bit(tmp_path):
    path = write_campaign(
        tmp_path,
        runs="70",
        keep="{histories: {flights: [3], rate: 10 Hz}, envelopes: {rate: 5 Hz}}",
    )
    folder = run(path, tmp_path / "flown", workers=1).folder
    experiment, flown = read_campaign(path), read_flown(folder).flights
    dataset = simulate_table(experiment, draw(experiment, 70), channels=[HEIGHT], engine=ENGINE)
    assert dataset.sizes["flight"] == 70 and tuple(dataset.controller.to_numpy()) == tuple(flown)
    for name, flights in flown.items():
        flights_of_one = dataset.sel(controller=name)
        for metric, values in flights.metrics.items():
            np.testing.assert_array_equal(flights_of_one[metric].to_numpy(), values)
        assert [code == "ok" for code in flights_of_one.outcome.to_numpy()] == (
            ~flights.failed
        ).tolist()
        again = replay_flight(folder, name, 3, ENGINE.fly).block
        height = dict(
            zip(again.times.tolist(), again.history[0, :, CHANNEL_INDEX[HEIGHT]], strict=True)
        )
        np.testing.assert_array_equal(
            flights_of_one[HEIGHT].sel(flight=3),
            [height[t] for t in dataset.time.to_numpy().tolist()],
        )


def test_other_parameters_are_nominal_and_the_index_numbers_flights(tmp_path):
    experiment = read_campaign(write_campaign(tmp_path))
    table = pd.DataFrame({"atmosphere.density": [0.9, 1.1]}, index=[7, 9])
    dataset = simulate_table(experiment, table, ["two"], engine=ENGINE)
    complete = pd.DataFrame({"atmosphere.density": [1.1], "aero.lift": [1.0]})
    same = simulate_table(experiment, complete, ["two"], engine=ENGINE)
    assert dataset.flight.to_numpy().tolist() == [7, 9]
    assert (
        dataset.altitude_error_max_m.sel(flight=9).item()
        == same.altitude_error_max_m.sel(flight=0).item()
    )


@pytest.mark.parametrize(
    ("table", "options", "pattern"),
    [
        ({"aero.lfit": [1.0]}, {}, "'aero.lfit'.*aero.lift"),
        ({"aero.lift": [np.nan]}, {}, "empty cells"),
        ({"aero.lift": ["1.1 m"]}, {}, "not numbers"),
        ({"aero.lift": []}, {}, "is empty"),
        ({"aero.lift": [1.0]}, {"controllers": ["three"]}, "'three'"),
        ({"aero.lift": [1.0]}, {"controllers": ["one", "one"]}, "'one' appears twice"),
        ({"aero.lift": [1.0]}, {"channels": ["height"]}, "'height'"),
    ],
)
def test_an_invalid_table_is_rejected(table, options, pattern, tmp_path):
    experiment = read_campaign(write_campaign(tmp_path))
    with pytest.raises(InputError, match=pattern):
        simulate_table(experiment, pd.DataFrame(table), engine=ENGINE, **options)


def test_flights_use_the_plan_with_margins_if_asked_and_present():
    experiment = SimpleNamespace(
        systems={"a": System("plain", "margins"), "b": System("plain", None)},
        rows=lambda rows: rows * 2,
        simulator=SimpleNamespace(engine=SimpleNamespace(fly=lambda *arguments: arguments)),
    )
    for name, margins, plan in (
        *(("a", True, "margins"), ("a", False, "plain"), ("b", True, "plain")),
    ):
        assert simulate(experiment, name, 3, 5, margins=margins) == (plan, 6, 5)
    assert simulate(experiment, "a", 3, None, lambda *arguments: arguments[1]) == 6


@pytest.mark.parametrize(
    ("address", "opened"),
    [("own://a:1", "own"), ("tcp://a:1", "tcp"), ("a:1", "tcp"), (None, None), ("x://a", "")],
)
def test_the_scheme_of_an_address_selects_the_scheduler(monkeypatch, address, opened):
    entries = {
        name: SimpleNamespace(load=lambda name=name: lambda given: nullcontext((name, given)))
        for name in ("own", "tcp")
    }
    monkeypatch.setattr(executor, "find_entry_points", lambda group: entries)
    if opened == "":
        with pytest.raises(InputError, match=r"'x://a'.*own://.*tcp://"), connect(address):
            pass
        return
    with connect(address) as scheduler:
        assert scheduler == (opened and (opened, address))
