"""What is read of a folder is of one campaign, however long its reader takes, and as it was written: one flipped bit
anywhere, and no reader takes it, and the message names the file."""

import random
import shutil
from dataclasses import replace

import pandas as pd
import pytest
from fake_flight import ENGINE, run, write_campaign
from report.synthetic import build_page
from search.known_flights import LINE, write_line

from abhv_mc.analysis.replay import replay_flight
from abhv_mc.api import compare
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.tables import export_csv, open_database
from abhv_mc.io.input_error import InputError
from abhv_mc.report.numbers.whatif import make_whatif
from abhv_mc.report.pages.build import build_report, is_up_to_date
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.requests import Request, WorstRequest
from abhv_mc.results import open_results
from abhv_mc.search.worst import find_worst
from abhv_mc.topics import registry

CHANGED = "a run has written here meanwhile"


KEEP = "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: [altitude_m, bank_deg]}}"
METRIC = "altitude_error_max_m"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    return run(
        write_campaign(root / "f", runs="60", keep=KEEP, execution="{batch: 20}"), root / "out"
    ).folder


@pytest.fixture
def request_(flown, tmp_path):
    """For a copy of it."""
    return Request(flown.parent / "f/campaign.yaml", shutil.copytree(flown, tmp_path / "out"))


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    root = tmp_path_factory.mktemp("searched")
    find_worst(WorstRequest(write_line(root / "f"), root / "out", METRIC, flights=160), LINE)
    return root / "out"


@pytest.fixture
def fly_meanwhile(request_):
    """A run that takes the place of what a reader has begun to read."""
    return lambda *_: run_campaign(replace(request_, seed=99, fresh=True), ENGINE)


def test_a_query(request_, fly_meanwhile):
    def ask():
        with open_database(request_.output) as database:
            fly_meanwhile()
            return database.sql("select count(*) from samples, flights").fetchall()

    with pytest.raises(InputError, match=CHANGED):
        ask()


@pytest.mark.parametrize(
    "ask",
    [
        lambda results: results.samples,
        lambda results: results.query("select count(*) from flights"),
        lambda results: results.make_report(),
    ],
)
def test_a_notebook(request_, fly_meanwhile, monkeypatch, ask):
    """Flights of one campaign stood beside samples of the other, which drivers then came from."""
    monkeypatch.setattr("abhv_mc.simulators.vehicle_simulator.make_engine", lambda: ENGINE)
    results = open_results(request_.output)
    run_campaign(request_, ENGINE)  # with nothing to do: it disturbs nobody
    before = results.flights
    assert results.controllers == ("one", "two")
    fly_meanwhile()
    with pytest.raises(InputError, match=CHANGED):
        ask(results)
    pd.testing.assert_frame_equal(results.flights, before)


def test_a_report(request_, fly_meanwhile, monkeypatch):
    """It was 'up to date' ever after, with numbers of the campaign before."""
    build_page(request_.output)
    make_figures = registry.make_figures
    monkeypatch.setattr(registry, "make_figures", lambda *a: (fly_meanwhile(), make_figures(*a))[1])
    with pytest.raises(InputError, match=CHANGED):
        build_page(request_.output)
    monkeypatch.undo()
    assert not is_up_to_date(request_.output)
    build_page(request_.output)
    assert is_up_to_date(request_.output)


READERS = {
    "report": build_report,
    "query": lambda folder: open_database(folder).__enter__(),
    "notebook": open_results,
    "export": lambda folder: list(export_csv(folder, folder / "csv")),
    "compare": lambda folder: compare(folder, folder),
    "whatif": lambda folder: make_whatif(folder, {}),
}


def files_of(folder):
    return sorted(
        path.relative_to(folder)
        for path in folder.rglob("*")
        if path.is_file() and path.name != ".lock"
    )


def flip(path, place, bit):
    content = bytearray(path.read_bytes())
    content[place] ^= 1 << bit
    path.write_bytes(bytes(content))


def flips(folder):
    """Bits of every file: in the first and the last byte, which no page's checksum covers, and between."""
    chance = random.Random(2026)
    for file in files_of(folder):
        size = (folder / file).stat().st_size
        places = {0, size - 1, chance.randrange(size)}
        yield from (
            (file, place, chance.randrange(8)) for place in sorted(places) if 0 <= place < size
        )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("made", "readers"), [("flown", [*READERS]), ("searched", ["query", "notebook", "export"])]
)
def test_readers_refuse_any_flipped_bit_and_name_the_file(made, readers, request):
    folder = request.getfixturevalue(made)
    listed = open_results(folder).manifest.files
    assert sorted(listed) == [
        file.as_posix() for file in files_of(folder) if file.name != "manifest.json"
    ]
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


@pytest.mark.thorough
def test_a_folder_in_which_somebody_flies_is_not_called_damaged(flown, tmp_path):
    """A run that goes on writes its envelopes before its manifest: readers asked for the file to be restored."""
    folder = tmp_path / "out"
    shutil.copytree(flown, folder)
    flip(folder / "envelopes.parquet", 100, 1)
    with (
        hold_lock(folder / ".lock"),
        pytest.raises(InputError, match=r"while process .* flies .* the end of that run"),
    ):
        read_flown(folder)
    with (
        hold_lock(folder / ".lock"),
        pytest.raises(InputError, match=r"campaign that process .* is flying"),
    ):
        list(verify_campaign(folder))
    with pytest.raises(InputError, match="damaged, or changed since"):
        read_flown(folder)


@pytest.mark.thorough
def test_replay_looks_at_what_it_reads(flown):
    folder = flown
    for part in ("plans/one.npz", "samples.parquet", "flights/one-000000000-000000020.parquet"):
        flip(folder / part, 40, 3)
        with pytest.raises(InputError, match=part.rpartition("/")[2]):
            replay_flight(folder, "one", 3, ENGINE.fly)
        flip(folder / part, 40, 3)
    assert not replay_flight(folder, "one", 3, ENGINE.fly).differences


@pytest.mark.thorough
def test_the_search_flies_a_damaged_block_again(searched, tmp_path):
    whole = {
        file: (searched / file).read_bytes()
        for file in files_of(searched)
        if file.name != "manifest.json"
    }
    campaign = searched.parent / "f/campaign.yaml"
    request = WorstRequest(campaign, tmp_path / "out", METRIC, flights=160)
    for file in (file for file in whole if file.parts[0] == "flights"):
        shutil.copytree(searched, request.output, dirs_exist_ok=True)
        flip(request.output / file, 1000, 3)
        find_worst(request, LINE)
        assert {name: (request.output / name).read_bytes() for name in whole} == whole, file
