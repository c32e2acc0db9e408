"""Tests with malicious folders: no code is executed, SQL is confined, output is escaped.

See also execution/test_user_code (control laws) and remote/test_store (names that leave a folder).
"""

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
from abhv_mc.folder.layout import hash_file, is_inside
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
def foreign_folder(folder, fake_engine, tmp_path):
    return shutil.copytree(folder, tmp_path / "out")


@pytest.mark.parametrize("name", ["", "/a", "../a"])
def test_names_outside_the_folder_are_recognized(name):
    assert is_inside("a") and not is_inside(name)


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
def test_sql_cannot_access_other_files(folder, tmp_path, statement):
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
def test_only_intact_envelope_blocks_of_this_campaign_are_used(tmp_path, values, flights, taken):
    write_array(tmp_path / "blocks/one-000000000-000000064.npy", values)
    cells = Cells(("altitude_m", "speed_mps"), (0, 1), 1, np.arange(3.0))
    covered = Collector(tmp_path, "one", np.ones(flights, bool), cells).covered
    assert covered.all() if taken else not covered.any()


def commands(campaign, folder):
    """Yield the commands that read a folder."""
    yield "runs", folder
    yield "query", folder, "select * from flights"
    yield "query", folder, "--csv", "csv"
    yield "report", folder
    yield "verify", "campaign", folder
    yield "compare", folder, folder
    yield "tighten", folder, "aero.lift.sigma=4%"
    yield "replay", folder, "--flight", 3, "--controller", "one"
    yield "explain", folder, "--flight", 3
    yield "run", campaign, "-o", folder, "--no-report"


def sign(folder):
    """Update the hashes in the manifest."""
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
def test_no_command_executes_content_of_a_folder(foreign_folder, folder, abhv_mc, spoil):
    """The hashes of the malicious files are valid."""
    executed = foreign_folder.parent / "executed"

    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(executed),)

    spoil(foreign_folder, Evil())
    sign(foreign_folder)
    for command in commands(folder.parent / "f/campaign.yaml", foreign_folder):
        output = "".join(abhv_mc(*command)[1:])
        assert "Traceback" not in output, (command, output)
        assert not executed.exists(), command


@pytest.mark.thorough
def test_control_characters_are_escaped_in_output(foreign_folder, abhv_mc):
    table = pq.read_table(foreign_folder / "envelopes.parquet")
    escapes = pa.array(["\x1b[2J\u202e"] * len(table))
    table = table.set_column(table.column_names.index("channel"), "channel", escapes)
    pq.write_table(table, foreign_folder / "envelopes.parquet")
    sign(foreign_folder)
    output = "".join(abhv_mc("query", foreign_folder, "select channel from envelopes")[1:])
    assert "\\u202e" in output and not {"\x1b", "\u202e"} & set(output)
