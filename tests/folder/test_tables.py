"""SQL over a stranger's folder sees its tables and nothing else of the machine."""

import duckdb
import pytest
from fake_flight import run, write_campaign

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
