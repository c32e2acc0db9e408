"""One flipped bit anywhere in a campaign's folder: no reader takes it, and the message names the file."""

import random
import shutil

import pytest
from fake_flight import ENGINE, write_campaign
from search.known_flights import LINE, write_line

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.api import compare
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.tables import export_csv, open_database
from abhv_mc.io.input_error import InputError
from abhv_mc.report.numbers.whatif import make_whatif
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.results import open_results
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.worst import WorstSettings, find_worst

KEEP = "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: [altitude_m, bank_deg]}}"
READERS = {
    "report": build_report,
    "query": lambda folder: open_database(folder).__enter__(),
    "notebook": open_results,
    "export": lambda folder: list(export_csv(folder, folder / "csv")),
    "compare": lambda folder: compare(folder, folder),
    "whatif": lambda folder: make_whatif(folder, {}),
}
SEED = 2026


WORST = WorstSettings("altitude_error_max_m", flights=160)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    campaign = write_campaign(root / "f", runs="60", keep=KEEP, execution="{batch: 20}")
    run_campaign(Request(campaign, root / "out"), ENGINE)
    return root / "out"


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    root = tmp_path_factory.mktemp("searched")
    find_worst(SearchRequest(write_line(root / "f"), root / "out"), WORST, LINE)
    return root / "out"


def files_of(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name != ".lock")


def flip(path, place, bit):
    content = bytearray(path.read_bytes())
    content[place] ^= 1 << bit
    path.write_bytes(bytes(content))


def flips(folder):
    """Bits of every file: in the first and the last byte, which no page's checksum covers, and between."""
    chance = random.Random(SEED)
    for file in files_of(folder):
        size = (folder / file).stat().st_size
        places = {0, size - 1, chance.randrange(size)}
        yield from ((file, place, chance.randrange(8)) for place in sorted(places) if 0 <= place < size)


@pytest.mark.parametrize(("made", "readers"), [("flown", [*READERS]), ("searched", ["query", "notebook", "export"])])
def test_readers_refuse_any_flipped_bit_and_name_the_file(made, readers, request):
    folder = request.getfixturevalue(made)
    listed = open_results(folder).manifest.files
    assert sorted(listed) == [file.as_posix() for file in files_of(folder) if file.name != "manifest.json"]
    for file, place, bit in flips(folder):
        flip(folder / file, place, bit)
        for name in readers:
            with pytest.raises(InputError) as refused:
                READERS[name](folder)
            assert file.name in str(refused.value), (name, file, place, bit)
        if file.name != "manifest.json":
            assert next(verify_campaign(folder)).startswith(file.as_posix())
        flip(folder / file, place, bit)
    open_results(folder)


def test_a_folder_in_which_somebody_flies_is_not_called_damaged(flown, tmp_path):
    """A run that goes on writes its envelopes before its manifest: readers asked for the file to be restored."""
    folder = tmp_path / "out"
    shutil.copytree(flown, folder)
    flip(folder / "envelopes.parquet", 100, 1)
    with hold_lock(folder / ".lock"), pytest.raises(InputError, match=r"while process .* flies .* the end of that run"):
        read_flown(folder)
    with hold_lock(folder / ".lock"), pytest.raises(InputError, match=r"campaign that process .* is flying"):
        list(verify_campaign(folder))
    with pytest.raises(InputError, match="damaged, or changed since"):
        read_flown(folder)


def test_replay_looks_at_what_it_reads(flown):
    folder = flown
    for part in ("plans/one.npz", "samples.parquet", "flights/one-000000000-000000020.parquet"):
        flip(folder / part, 40, 3)
        with pytest.raises(InputError, match=part.rpartition("/")[2]):
            replay_flight(folder, "one", 3, ENGINE.fly)
        flip(folder / part, 40, 3)
    assert not replay_flight(folder, "one", 3, ENGINE.fly).differences


def test_the_search_flies_a_damaged_block_again(searched, tmp_path):
    whole = {file: (searched / file).read_bytes() for file in files_of(searched) if file.name != "manifest.json"}
    request = SearchRequest(searched.parent / "f/campaign.yaml", tmp_path / "out")
    for file in (file for file in whole if file.parts[0] == "flights"):
        shutil.copytree(searched, request.out, dirs_exist_ok=True)
        flip(request.out / file, 1000, 3)
        find_worst(request, WORST, LINE)
        assert {name: (request.out / name).read_bytes() for name in whole} == whole, file
