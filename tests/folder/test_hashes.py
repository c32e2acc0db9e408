"""Tests that readers reject folders that are changed while they read, and any flipped bit."""

import os
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
from abhv_mc.folder.hashes import DAMAGED, REPLACED, Products, record_hashes, refuse_changes
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.folder.tables import export_csv, open_database
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.whatif import make_whatif
from abhv_mc.report.pages.build import build_report, is_up_to_date
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.requests import Request, WorstRequest
from abhv_mc.results import open_results
from abhv_mc.search.worst import find_worst
from abhv_mc.topics import registry

KEEP = (
    "{histories: {flights: [worst 3], rate: 10 Hz}, envelopes: {rate: 2 Hz, channels: "
    "[altitude_m, bank_deg]}}"
)
METRIC = "altitude_error_max_m"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    root = tmp_path_factory.mktemp("flown")
    return run(
        write_campaign(root / "f", runs="60", keep=KEEP, execution="{batch: 20}"), root / "out"
    ).folder


@pytest.fixture
def request_(flown, tmp_path):
    """Request for a copy of the folder."""
    return Request(flown.parent / "f/campaign.yaml", shutil.copytree(flown, tmp_path / "out"))


def test_only_replaced_and_removed_files_are_changes(flown):
    folder = CampaignFolder(flown)
    manifest = read_manifest(folder.manifest)
    first, *others = manifest.files
    refuse_changes(folder, replace(manifest, files={name: manifest.files[name] for name in others}))
    for change in ({first: "0"}, {"removed": "0"}):
        with pytest.raises(InputError, match=REPLACED):
            refuse_changes(folder, replace(manifest, files={**manifest.files, **change}))


def test_products_are_those_of_the_controllers_and_their_flights(flown, tmp_path):
    keys = [Products(CampaignFolder(tmp_path), ("b", "a"), runs) for runs in (60, 5000)]
    assert [key.envelopes.key for key in keys] == ["a b 60", "a b 4096"]
    assert [key.samples.key for key in keys] == ["60", "5000"]
    folder = CampaignFolder(flown)
    listed = read_manifest(folder.manifest).files
    stale = {"samples.parquet", "envelopes.parquet"}
    for runs, forgotten in ((60, set()), (61, stale)):
        with record_hashes(folder, listed) as files:
            Products(folder, ("two", "one"), runs).forget_stale(files)
        assert listed.keys() - files.listed().keys() == forgotten


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    root = tmp_path_factory.mktemp("searched")
    find_worst(WorstRequest(write_line(root / "f"), root / "out", METRIC, flights=160), LINE)
    return root / "out"


@pytest.fixture
def fly_meanwhile(request_):
    """Return a function that replaces the campaign while a reader reads it."""
    return lambda *_: run_campaign(replace(request_, seed=99, fresh=True), ENGINE)


def test_a_query(request_, fly_meanwhile):
    def ask():
        with open_database(request_.output) as database:
            fly_meanwhile()
            return database.sql("select count(*) from samples, flights").fetchall()

    with pytest.raises(InputError, match=REPLACED):
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
    """Flights of one campaign were combined with samples of the other."""
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: ENGINE)
    results = open_results(request_.output)
    run_campaign(request_, ENGINE)  # resumes a complete campaign and changes nothing
    before = results.flights
    assert results.controllers == ("one", "two")
    fly_meanwhile()
    with pytest.raises(InputError, match=REPLACED):
        ask(results)
    pd.testing.assert_frame_equal(results.flights, before)


def test_a_report(request_, fly_meanwhile, monkeypatch):
    """The report of the replaced campaign was considered up to date."""
    build_page(request_.output)
    make_figures = registry.make_figures
    monkeypatch.setattr(registry, "make_figures", lambda *a: (fly_meanwhile(), make_figures(*a))[1])
    with pytest.raises(InputError, match=REPLACED):
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


def flip(path, position, bit):
    content = bytearray(path.read_bytes())
    content[position] ^= 1 << bit
    path.write_bytes(bytes(content))


def flips(folder):
    """Yield bits of every file: in the first and last byte, without checksum, and in between."""
    chance = random.Random(2026)
    for file in files_of(folder):
        size = (folder / file).stat().st_size
        positions = {0, size - 1, chance.randrange(size)}
        yield from (
            (file, position, chance.randrange(8))
            for position in sorted(positions)
            if 0 <= position < size
        )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("fixture", "readers"), [("flown", [*READERS]), ("searched", ["query", "notebook", "export"])]
)
def test_readers_refuse_any_flipped_bit_and_name_the_file(fixture, readers, request):
    folder = request.getfixturevalue(fixture)
    listed = open_results(folder).manifest.files
    assert sorted(listed) == [
        file.as_posix() for file in files_of(folder) if file.name != "manifest.json"
    ]
    for file, position, bit in flips(folder):
        flip(folder / file, position, bit)
        for name in readers:
            with pytest.raises(InputError) as refused:
                READERS[name](folder)
            assert file.name in str(refused.value), (name, file, position, bit)
        if file.name != "manifest.json":
            assert next(verify_campaign(folder)).startswith(file.as_posix())
        flip(folder / file, position, bit)
    open_results(folder)


@pytest.mark.thorough
def test_a_folder_in_use_is_not_reported_as_damaged(flown, tmp_path):
    """A resumed run writes its envelopes before its manifest."""
    folder = tmp_path / "out"
    shutil.copytree(flown, folder)
    flip(folder / "envelopes.parquet", 100, 1)
    with (
        hold_lock(folder / ".lock"),
        pytest.raises(InputError, match=rf"while process {os.getpid()} on"),
    ):
        read_flown(folder)
    with (
        hold_lock(folder / ".lock"),
        pytest.raises(InputError, match=rf"process {os.getpid()} on"),
    ):
        list(verify_campaign(folder))
    with pytest.raises(InputError, match=DAMAGED):
        read_flown(folder)


@pytest.mark.thorough
def test_replay_checks_the_files_that_it_reads(flown):
    folder = flown
    for name in ("plans/one.npz", "samples.parquet", "flights/one-000000000-000000020.parquet"):
        flip(folder / name, 40, 3)
        with pytest.raises(InputError, match=name.rpartition("/")[2]):
            replay_flight(folder, "one", 3, ENGINE.fly)
        flip(folder / name, 40, 3)
    assert not replay_flight(folder, "one", 3, ENGINE.fly).differences


@pytest.mark.thorough
def test_a_search_runs_a_damaged_block_again(searched, tmp_path):
    contents = {
        file: (searched / file).read_bytes()
        for file in files_of(searched)
        if file.name != "manifest.json"
    }
    campaign = searched.parent / "f/campaign.yaml"
    request = WorstRequest(campaign, tmp_path / "out", METRIC, flights=160)
    for file in (file for file in contents if file.parts[0] == "flights"):
        shutil.copytree(searched, request.output, dirs_exist_ok=True)
        flip(request.output / file, 1000, 3)
        find_worst(request, LINE)
        assert {name: (request.output / name).read_bytes() for name in contents} == contents, file
