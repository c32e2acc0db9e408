"""SQL over a stranger's folder sees its tables and nothing else of the machine."""

import duckdb
import pytest
from fake_flight import ENGINE, write_campaign

from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder import database
from abhv_mc.folder.database import open_database
from abhv_mc.folder.hashes import CheckedFolder
from abhv_mc.io.input_error import InputError


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    return run_campaign(Request(write_campaign(root / "f", runs="40"), root / "out"), ENGINE).folder


def test_every_table_answers(folder):
    with open_database(folder) as database:
        names = ("flights", "samples", "histories", "envelopes", "nominal", "reference")
        counts = {name: len(database.sql(f"from {name}").fetchall()) for name in names}
        assert counts["samples"] == 40 and counts["flights"] == 80 and all(counts.values())
        query = "select avg(\"aero.lift\") from flights where controller = 'one' and flight < 10"
        assert database.sql(query).fetchall()[0][0] is not None


def test_margins_are_no_table(folder, monkeypatch):
    checked = CheckedFolder(folder)
    held = checked.folder
    monkeypatch.setattr(database, "data_files", lambda *_: [held.margins, held.samples])
    assert database.table_files(checked) == {"samples": [held.samples]}


def test_a_working_folder_that_was_deleted(folder, tmp_path, monkeypatch):
    """duckdb ended the process."""
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError), open_database(folder):
        pass


@pytest.mark.parametrize(
    "statement",
    [
        "copy flights to '{out}/leak.csv'",
        "copy flights to '{out}/leak.parquet' (format parquet)",
        "select * from read_csv('{out}/secret.csv')",
        "select * from read_text('{out}/secret.csv')",
        "select * from '{out}/secret.csv'",
        "select * from read_parquet('{folder}/samples.parquet')",
        "attach '{out}/other.db'",
        "export database '{out}/all'",
        "install httpfs",
        "load httpfs",
        "set enable_external_access = true",
        "set lock_configuration = false",
        "reset enable_external_access",
        "set temp_directory = '{out}'",
        "select * from glob('{out}/*')",
        "select * from folder",
    ],
)
def test_nothing_leads_out(folder, tmp_path, statement):
    (tmp_path / "secret.csv").write_text("a\n1\n")
    with open_database(folder) as database, pytest.raises(duckdb.Error):
        database.sql(statement.format(out=tmp_path, folder=folder)).fetchall()
    assert [path.name for path in tmp_path.iterdir()] == ["secret.csv"]


@pytest.mark.parametrize("part", ["flights", "samples.parquet", "inputs"])
def test_links_that_lead_out_are_refused(folder, tmp_path, part):
    place, elsewhere = folder / part, tmp_path / part
    place.rename(elsewhere)
    place.symlink_to(elsewhere)
    try:
        with pytest.raises(InputError, match="leads out"):
            open_database(folder)
        manifest = (folder / "manifest.json").read_bytes()
        for fresh in (False, True):
            with pytest.raises(InputError, match="leads out"):
                run_campaign(Request(folder.parent / "f/campaign.yaml", folder, fresh=fresh), ENGINE)
        assert (folder / "manifest.json").read_bytes() == manifest and elsewhere.exists()
    finally:
        place.unlink()
        elsewhere.rename(place)
