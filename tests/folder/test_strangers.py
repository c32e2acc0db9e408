"""A stranger's folder: SQL over it sees its tables and nothing else of the machine; of the values of envelopes that it
holds, as shards are anybody's, only whole blocks of this campaign are taken."""

import duckdb
import numpy as np
import pytest
from fake_flight import run, write_campaign

from abhv_mc.folder.arrays import write_array
from abhv_mc.folder.envelope_states import Cells, Collector
from abhv_mc.folder.tables import open_database


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    return run(write_campaign(root / "f", runs="40"), root / "out").folder


@pytest.mark.parametrize(
    "statement",
    [
        "copy flights to '{out}/leak.csv'",
        "select * from read_csv('{out}/secret.csv')",
        "select * from '{out}/secret.csv'",
        "attach '{out}/other.db'",
        "install httpfs",
        "set enable_external_access = true",
        "select * from glob('{out}/*')",
        "select * from folder",
    ],
)
def test_nothing_leads_out(folder, tmp_path, statement):
    (tmp_path / "secret.csv").write_text("a\n1\n")
    with open_database(folder) as database, pytest.raises(duckdb.Error):
        database.sql(statement.format(out=tmp_path, folder=folder)).fetchall()
    assert [path.name for path in tmp_path.iterdir()] == ["secret.csv"]


@pytest.mark.parametrize(
    ("values", "flights", "taken"),
    [
        (np.zeros((68, 6), np.float32), 64, True),
        (np.zeros((68, 6), np.float32), 63, False),  # beyond the campaign
        (np.zeros((68, 6)), 64, False),
        (np.zeros((68, 6), "<U3"), 64, False),
        (np.zeros((68, 5), np.float32), 64, False),
        (np.zeros(68, np.float32), 64, False),
    ],
)
def test_only_a_block_of_the_campaigns_type_and_shape_is_taken(tmp_path, values, flights, taken):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", values)
    cells = Cells(("altitude_m", "speed_mps"), (0, 1), 1, np.arange(3.0))
    covered = Collector(tmp_path, "one", np.ones(flights, bool), cells).covered
    assert covered.all() if taken else not covered.any()
