"""One flipped bit anywhere in a campaign's folder: no reader takes it, and the same command mends it."""

import random
import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, write_campaign
from search.line_flight import LINE, write_line

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.database import open_database
from abhv_mc.folder.export import export_csv
from abhv_mc.folder.hashes import refuse_links
from abhv_mc.folder.lock import hold_lock
from abhv_mc.io.input_error import InputError
from abhv_mc.notebook import open_results
from abhv_mc.report.numbers.compare import compare_folders
from abhv_mc.report.numbers.results import read_results
from abhv_mc.report.numbers.whatif import make_whatif
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.worst import WorstSettings, find_worst

KEEP = "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: [altitude_m, bank_deg]}}"
READERS = {
    "report": build_report,
    "query": open_database,
    "notebook": open_results,
    "export": lambda folder: list(export_csv(folder, folder / "csv")),
    "compare": lambda folder: compare_folders(folder, folder),
    "whatif": lambda folder: make_whatif(folder, {}),
}
SEED = 2026


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    campaign = write_campaign(root / "f", runs="60", keep=KEEP, execution="{batch: 20}")
    run_campaign(Request(campaign, root / "out"), ENGINE)
    return campaign, root / "out"


def files_of(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name != ".lock")


def flip(path, place, bit):
    content = bytearray(path.read_bytes())
    content[place] ^= 1 << bit
    path.write_bytes(bytes(content))


def flips(folder):
    """Bits of every file: the first and the last bytes, which no page's checksum covers, and some between."""
    chance = random.Random(SEED)
    for file in files_of(folder):
        size = (folder / file).stat().st_size
        places = {0, 3, size // 2, size - 1, size - 5, size - 9, *(chance.randrange(size) for _ in range(6))}
        yield from ((file, place, chance.randrange(8)) for place in sorted(places) if 0 <= place < size)


def test_the_manifest_names_every_file(flown):
    _, folder = flown
    listed = open_results(folder).manifest["files"]
    assert sorted(listed) == [file.as_posix() for file in files_of(folder) if file.name != "manifest.json"]


def test_readers_refuse_any_flipped_bit_and_name_the_file(flown):
    _, folder = flown
    for file, place, bit in flips(folder):
        flip(folder / file, place, bit)
        for name, read in READERS.items():
            with pytest.raises(InputError) as refused:
                read(folder)
            assert file.name in str(refused.value), (name, file, place, bit)
        if file.name != "manifest.json":
            assert next(verify_campaign(folder)).startswith(file.as_posix())
        flip(folder / file, place, bit)
    read_results(folder)


def test_run_mends_any_flipped_bit(flown, tmp_path, capfd):
    campaign, folder = flown
    whole = {file: (folder / file).read_bytes() for file in files_of(folder) if file.name != "manifest.json"}
    digest = open_results(folder).manifest["digest"]
    chance = random.Random(SEED)
    for file, content in whole.items():
        for place in {1, chance.randrange(len(content))}:
            out = tmp_path / "out"
            shutil.copytree(folder, out)
            flip(out / file, place, chance.randrange(8))
            result = run_campaign(Request(campaign, out), ENGINE)
            assert result.complete and result.manifest["digest"] == digest, (file, place)
            assert {name: (out / name).read_bytes() for name in whole} == whole, (file, place)
            open_results(out)
            shutil.rmtree(out)


def test_a_folder_in_which_somebody_flies_is_not_called_damaged(flown, tmp_path):
    """A run that goes on writes its envelopes before its manifest: readers asked for the file to be restored."""
    folder = tmp_path / "out"
    shutil.copytree(flown[1], folder)
    flip(folder / "envelopes.parquet", 100, 1)
    with hold_lock(folder / ".lock"), pytest.raises(InputError, match=r"while process .* flies .* the end of that run"):
        read_results(folder)
    with hold_lock(folder / ".lock"), pytest.raises(InputError, match=r"campaign that process .* is flying"):
        list(verify_campaign(folder))
    with pytest.raises(InputError, match="damaged, or changed since"):
        read_results(folder)


def test_a_file_that_goes_while_the_folder_is_looked_through_is_no_device(flown, monkeypatch):
    """What a run writes aside goes at any moment: it was called a pipe, socket or device."""
    listed = Path.rglob
    monkeypatch.setattr(Path, "rglob", lambda path, pattern: [*listed(path, pattern), path / ".x.0.aside"])
    refuse_links(flown[1])


def test_replay_looks_at_what_it_reads(flown):
    _, folder = flown
    for part in ("plans/one.npz", "samples.parquet", "flights/one-000000000-000000020.parquet"):
        flip(folder / part, 40, 3)
        with pytest.raises(InputError, match=part.rpartition("/")[2]):
            replay_flight(folder, "one", 3, ENGINE.fly)
        flip(folder / part, 40, 3)
    assert not replay_flight(folder, "one", 3, ENGINE.fly).differences


def test_a_file_that_the_campaign_did_not_write_is_refused(flown):
    _, folder = flown
    foreign = folder / "flights" / "one-000000060-000000080.parquet"
    shutil.copyfile(folder / "flights/one-000000000-000000020.parquet", foreign)
    try:
        with pytest.raises(InputError, match="does not name"):
            open_database(folder)
    finally:
        foreign.unlink()


def test_folders_of_older_versions_are_read_with_a_note(flown, tmp_path, capfd):
    import json

    campaign, folder = flown
    out = tmp_path / "old"
    shutil.copytree(folder, out)
    manifest = json.loads((out / "manifest.json").read_text())
    del manifest["files"], manifest["manifest_hash"]
    (out / "manifest.json").write_text(json.dumps(manifest))
    assert open_results(out).complete
    assert "older version" in capfd.readouterr().err
    assert run_campaign(Request(campaign, out), ENGINE).complete  # nothing to fly
    result = run_campaign(Request(campaign, out, runs=80), ENGINE)
    assert sorted(result.manifest["files"]) == [f.as_posix() for f in files_of(out) if f.name != "manifest.json"]
    assert open_results(out).samples.shape[0] == pq.read_table(out / "samples.parquet").num_rows == 80


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    root = tmp_path_factory.mktemp("searched")
    request = SearchRequest(write_line(root / "f"), root / "out")
    find_worst(request, WORST, LINE)
    return request


WORST = WorstSettings("altitude_error_max_m", flights=160)


def test_readers_refuse_any_flipped_bit_of_a_searchs_folder(searched):
    folder = searched.out
    assert sorted(open_results(folder).manifest["files"]) == [
        file.as_posix() for file in files_of(folder) if file.name != "manifest.json"
    ]
    for file, place, bit in flips(folder):
        flip(folder / file, place, bit)
        for name in ("query", "notebook", "export"):
            with pytest.raises(InputError) as refused:
                READERS[name](folder)
            assert file.name in str(refused.value), (name, file, place, bit)
        if file.name != "manifest.json":
            assert next(verify_campaign(folder)).startswith(file.as_posix())
        flip(folder / file, place, bit)
    assert not list(verify_campaign(folder))


def test_the_search_mends_any_flipped_bit_of_its_folder(searched, tmp_path, capfd):
    folder = searched.out
    whole = {file: (folder / file).read_bytes() for file in files_of(folder) if file.name != "manifest.json"}
    chance = random.Random(SEED)
    for file, content in whole.items():
        out = tmp_path / "out"
        shutil.copytree(folder, out)
        flip(out / file, chance.randrange(len(content)), chance.randrange(8))
        find_worst(replace(searched, out=out), WORST, LINE)
        assert {name: (out / name).read_bytes() for name in whole} == whole, file
        assert not list(verify_campaign(out))
        shutil.rmtree(out)


def test_a_search_follows_no_link_out_of_its_folder(searched, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(searched.out, out)
    shutil.move(out / "flights", tmp_path / "flights")
    (out / "flights").symlink_to(tmp_path / "flights")
    for fresh in (False, True):
        with pytest.raises(InputError, match="link"):
            find_worst(replace(searched, out=out, fresh=fresh), WORST, LINE)
    assert any((tmp_path / "flights").iterdir())
