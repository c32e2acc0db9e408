"""A campaign's folder made to harm its reader: it runs no code, and what it says steers no terminal.

Whoever writes such a folder writes its hashes too: all of them are right here. See also tests/execution/test_user_code
(laws of others), tests/folder/test_remote (names that lead out).
"""

import os
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_flight import run, write_campaign

from abhv_mc.folder.layout import hash_file
from abhv_mc.folder.manifest import read_manifest, write_manifest

pytestmark = pytest.mark.usefixtures("fake_engine")


@pytest.fixture
def folder(tmp_path, capfd):
    keep = "{envelopes: {rate: 2 Hz, channels: [altitude_m]}}"
    campaign = write_campaign(tmp_path / "f", runs="40", keep=keep, execution="{batch: 20}")
    return run(campaign, tmp_path / "out").folder


def commands(campaign, folder):
    """What people do with a folder that they were given."""
    yield "status", folder
    yield "query", folder, "select * from flights"
    yield "export", folder, "-o", "csv"
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
    path.write_text(path.read_text() + f"question: !!python/object/apply:os.mkdir ['{folder.parent / 'executed'}']\n")


def pickle_a_state(folder, evil):
    (folder / "envelope_states/blocks").mkdir(parents=True)
    np.save(folder / "envelope_states/blocks/one-000000000-000000020.npy", np.array([evil], object))


@pytest.mark.parametrize("spoil", [pickle_a_plan, tag_the_campaign, pickle_a_state])
def test_no_command_runs_what_a_folder_holds(folder, abhv_mc, spoil):
    executed = folder.parent / "executed"

    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(executed),)

    spoil(folder, Evil())
    sign(folder)
    for words in commands(folder.parent / "f/campaign.yaml", folder):
        said = "".join(abhv_mc(*words)[1:])
        assert "Traceback" not in said, (words, said)
        assert not executed.exists(), words


def test_nothing_that_is_printed_steers_the_terminal(folder, abhv_mc):
    table = pq.read_table(folder / "envelopes.parquet")
    words = pa.array(["\x1b[2J\u202e"] * len(table))
    table = table.set_column(table.column_names.index("channel"), "channel", words)
    pq.write_table(table, folder / "envelopes.parquet")
    sign(folder)
    said = "".join(abhv_mc("query", folder, "select channel from envelopes")[1:])
    assert "\\u202e" in said and not {"\x1b", "\u202e"} & set(said)
