"""A stranger's folder: no command runs what it holds, SQL over it sees its tables and nothing else of the machine, and
what it says steers no terminal. See also execution/test_user_code (laws of others), remote/test_store (names that lead
out)."""

import os
import shutil
from dataclasses import replace

import duckdb
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import run, write_campaign

from abhv_mc.folder.arrays import write_array
from abhv_mc.folder.envelope_states import Cells, Collector
from abhv_mc.folder.layout import hash_file
from abhv_mc.folder.manifest import read_manifest, write_manifest
from abhv_mc.folder.tables import open_database


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    keep = "{envelopes: {rate: 2 Hz, channels: [altitude_m]}}"
    return run(
        write_campaign(root / "f", runs="40", keep=keep, execution="{batch: 20}"), root / "out"
    ).folder


@pytest.fixture
def given(folder, fake_engine, tmp_path):
    return shutil.copytree(folder, tmp_path / "out")


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
def test_of_the_values_of_envelopes_only_whole_blocks_of_this_campaign_are_taken(
    tmp_path, values, flights, taken
):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", values)
    cells = Cells(("altitude_m", "speed_mps"), (0, 1), 1, np.arange(3.0))
    covered = Collector(tmp_path, "one", np.ones(flights, bool), cells).covered
    assert covered.all() if taken else not covered.any()


def commands(campaign, folder):
    """What people do with a folder that they were given."""
    yield "runs", folder
    yield "query", folder, "select * from flights"
    yield "query", folder, "--csv", "csv"
    yield "report", folder
    yield "verify", "campaign", folder
    yield "compare", folder, folder
    yield "whatif", folder, "--set", "aero.lift.sigma=4%"
    yield "replay", folder, "--flight", 3, "--controller", "one"
    yield "explain", folder, "--flight", 3
    yield "run", campaign, "-o", folder, "--no-report"


def sign(folder):
    """Make the manifest's hashes those of the files that are there."""
    manifest = read_manifest(folder / "manifest.json")
    files = {name: hash_file(folder / name) for name in manifest.files}
    write_manifest(folder / "manifest.json", replace(manifest, files=files))


def pickle_a_plan(folder, evil):
    plan = folder / "plans/one.npz"
    np.savez(plan, **dict(np.load(plan)) | {"gains": np.array([evil], object)})


def tag_the_campaign(folder, evil):
    path = folder / "campaign.yaml"
    path.write_text(
        path.read_text()
        + f"question: !!python/object/apply:os.mkdir ['{folder.parent / 'executed'}']\n"
    )


def pickle_a_state(folder, evil):
    (folder / "envelope_states/blocks").mkdir(parents=True)
    np.save(folder / "envelope_states/blocks/one-000000000-000000020.npy", np.array([evil], object))


@pytest.mark.thorough
@pytest.mark.parametrize("spoil", [pickle_a_plan, tag_the_campaign, pickle_a_state])
def test_no_command_runs_what_a_folder_holds(given, folder, abhv_mc, spoil):
    """Whoever writes such a folder writes its hashes too."""
    executed = given.parent / "executed"

    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(executed),)

    spoil(given, Evil())
    sign(given)
    for words in commands(folder.parent / "f/campaign.yaml", given):
        said = "".join(abhv_mc(*words)[1:])
        assert "Traceback" not in said, (words, said)
        assert not executed.exists(), words


@pytest.mark.thorough
def test_nothing_that_is_printed_steers_the_terminal(given, abhv_mc):
    table = pq.read_table(given / "envelopes.parquet")
    words = pa.array(["\x1b[2J\u202e"] * len(table))
    table = table.set_column(table.column_names.index("channel"), "channel", words)
    pq.write_table(table, given / "envelopes.parquet")
    sign(given)
    said = "".join(abhv_mc("query", given, "select channel from envelopes")[1:])
    assert "\\u202e" in said and not {"\x1b", "\u202e"} & set(said)
