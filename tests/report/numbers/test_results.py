import numpy as np
import pyarrow.parquet as pq
import pytest
from report.synthetic import CONTROLLERS, write_campaign

from abhv_mc.flight.metrics import METRICS
from abhv_mc.folder.layout import hash_file
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.io.documents import InputError
from abhv_mc.numerics.bounds import Bounds
from abhv_mc.report.numbers.results import read_histories, read_results


def test_a_folder_reads_as_arrays(failing):
    assert failing.controllers == CONTROLLERS
    assert len(failing.metrics) == len(METRICS)
    assert failing.flights["lqr"].flight.tolist() == list(range(100))
    assert failing.flights["lqr"].failed.sum() == 12
    assert not failing.flights["tlc"].failed.any()
    density = failing.samples["atmosphere.density"]
    assert set(np.argsort(density)[-12:]) == set(np.flatnonzero(failing.flights["lqr"].failed))
    requirement = failing.campaign.requirements[0]
    assert (requirement.limits, requirement.controllers) == (Bounds(high=50.0), ("tlc",))
    assert requirement.early_is_failure


def test_histories_are_those_kept(failing_folder):
    kept = read_histories(failing_folder, "lqr")
    assert len(kept) == 20
    assert all(len(history["time"]) == 601 for history in kept.values())


def test_flights_that_could_not_be_computed_say_nothing(tmp_path):
    folder = write_campaign(tmp_path / "c", runs=10)
    path = folder / "flights" / "tlc-000000000-000000005.parquet"
    table = pq.read_table(path, partitioning=None)
    outcome = table["outcome"].to_pylist()
    outcome[3] = "failed_to_run"
    position = table.column_names.index("outcome")
    pq.write_table(table.set_column(position, table.schema.field("outcome"), [outcome]), path)
    manifest = read_manifest(folder / "manifest.json")
    files = manifest["files"] | {f"flights/{path.name}": hash_file(path)}
    write_manifest(folder / "manifest.json", manifest | {"files": files})
    flights = read_results(folder).flights["tlc"]
    assert flights.not_computed == 1
    assert 3 not in flights.flight
    assert not flights.failed.any()


def test_a_shard_is_no_campaign_yet(tmp_path):
    folder = write_campaign(tmp_path / "c", runs=4)
    path = folder / "manifest.json"
    write_manifest(path, read_manifest(path) | {"shard": [1, 3]})
    with pytest.raises(InputError, match="shard 1/3 of a campaign"):
        read_results(folder)


@pytest.mark.parametrize("name", ["manifest.json", "envelopes.parquet"])
def test_a_missing_file_is_bad_input(tmp_path, name):
    folder = write_campaign(tmp_path / "c", runs=4)
    (folder / name).unlink()
    with pytest.raises(InputError, match=name):
        read_results(folder)


def test_a_damaged_file_is_bad_input(tmp_path):
    folder = write_campaign(tmp_path / "c", runs=4)
    (folder / "samples.parquet").write_bytes(b"PAR1 nonsense")
    with pytest.raises(InputError, match=r"samples\.parquet"):
        read_results(folder)
