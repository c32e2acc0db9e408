"""Campaigns with derived inputs, whose folder stores the drawn inputs."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, fly, interrupted_after, make_plan, write_campaign

from abhv_mc.analysis.explain import explain_flight
from abhv_mc.analysis.replay import replay_flight
from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.requests import Request
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX

ENTRIES = {
    "dispersions": "{atmosphere.density: {distribution: mixture, parts: [{distribution: "
    "uniform, half_width: 9 %},"
    " {distribution: normal, mean: 1.05, sigma: 1 %}], weights: [1, 2]},"
    " aero.lift: {distribution: normal, sigma: 5 %}}",
    "derived": "{aero.drag: 1 + 2 * (aero.lift - 1), atmosphere.density: atmosphere.density - "
    "0.5 * (aero.lift - 1)}",
}


def run(tmp_path, name, engine=ENGINE, **entries):
    return run_campaign(
        Request(write_campaign(tmp_path / "files", **ENTRIES | entries), tmp_path / name), engine
    )


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return run(tmp_path_factory.mktemp("derived"), "whole")


def test_flights_use_derived_inputs_and_the_table_has_drawn_ones(flown):
    samples = pq.read_table(flown.folder / "samples.parquet").to_pandas()
    assert list(samples.columns[-2:]) == ["atmosphere.density", "aero.lift"]
    rows = np.tile(nominal_parameters()[0], (300, 1))
    density, lift = samples["atmosphere.density"].to_numpy(), samples["aero.lift"].to_numpy()
    rows[:, PARAMETER_INDEX["aero.lift"]] = lift
    rows[:, PARAMETER_INDEX["aero.drag"]] = 1.0 + 2.0 * (lift - 1.0)
    rows[:, PARAMETER_INDEX["atmosphere.density"]] = density - 0.5 * (lift - 1.0)
    table = (
        pq.read_table(flown.folder / "flights")
        .to_pandas()
        .query("controller == 'one'")
        .sort_values("flight")
    )
    block = fly(make_plan("one"), rows)
    for metric in ("altitude_error_max_m", "fuel_used_kg"):
        np.testing.assert_array_equal(
            table[metric].to_numpy(), block.metrics[:, METRIC_INDEX[metric]]
        )


def test_bits_do_not_depend_on_interrupts_and_blocks(flown, tmp_path):
    run(tmp_path, "resumed", interrupted_after(6))
    resumed = run(tmp_path, "resumed", execution="{workers: 1, batch: 17}")
    assert resumed.complete and resumed.manifest.digest == flown.manifest.digest
    for controller, flight in (("one", 3), ("two", 299)):
        assert replay_flight(flown.folder, controller, flight, fly).differences == ()
    for history in ("histories/one-000000.parquet", "envelopes.parquet"):
        assert pq.read_table(flown.folder / history).equals(pq.read_table(resumed.folder / history))
    with pytest.raises(InputError, match=r"derived"):
        run(tmp_path, "resumed", derived=ENTRIES["derived"].replace("2 *", "3 *"))


def test_a_failure_is_explained_by_drawn_inputs(flown):
    table = (
        pq.read_table(flown.folder / "flights")
        .to_pandas()
        .query("controller == 'two' and outcome != 'ok'")
    )
    explanations = [
        explain_flight(flown.folder, "two", int(flight), fly) for flight in table["flight"][:10]
    ]
    stored = read_flown(flown.folder).campaign
    assert explanations and {
        cause for explanation in explanations for cause in explanation.causes
    } <= {
        "atmosphere.density",
        "aero.lift",
    }
    for explanation in explanations:
        _, _, row = full_rows(stored.names, explanation.rows, stored.derived, stored.parameters)
        lift = row[PARAMETER_INDEX["aero.lift"]]
        assert row[PARAMETER_INDEX["aero.drag"]] == 1.0 + 2.0 * (lift - 1.0)
