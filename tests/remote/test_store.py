"""Campaigns on a local S3 server: run, interrupt, resume, report and query as in a folder."""

import json
import threading
from pathlib import Path

import pytest
from fake_flight import interrupted_after, write_campaign
from pyarrow import fs

from abhv_mc.folder.layout import StorageFullError
from abhv_mc.folder.stores import open_store
from abhv_mc.io.address import Address
from abhv_mc.io.messages import InputError
from abhv_mc_remote import store as remote
from abhv_mc_remote.store import Objects

server = pytest.importorskip("moto.server")
pytestmark = pytest.mark.usefixtures("fake_engine")


@pytest.fixture
def bucket(monkeypatch):
    """Yield a store with an empty bucket, and its address."""
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "testing")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setattr(remote, "_SETTLE", 0.0)
    monkeypatch.setattr(remote, "PUSH_INTERVAL", 0.05)
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    _, port = running.get_host_and_port()
    store = fs.S3FileSystem(
        endpoint_override=f"127.0.0.1:{port}", scheme="http", allow_bucket_creation=True
    )
    store.create_dir(f"campaigns-{port}")
    yield (
        store,
        f"s3://campaigns-{port}/first?endpoint_override=127.0.0.1:{port}&scheme=http",
        f"campaigns-{port}/first",
    )
    running.stop()


def names(store, base):
    objects = store.get_file_info(fs.FileSelector(base, recursive=True, allow_not_found=True))
    return {info.path[len(base) + 1 :] for info in objects if info.type == fs.FileType.File}


def manifest_of(store, base):
    with store.open_input_stream(f"{base}/manifest.json") as stream:
        return json.loads(stream.read())


def test_run_resume_report_and_query(bucket, abhv_mc, tmp_path, monkeypatch):
    store, address, base = bucket
    campaign = write_campaign(tmp_path / "f")
    assert abhv_mc(f"run {campaign} -o {tmp_path / 'whole'} --no-report")[0] == 0
    with monkeypatch.context() as patched:
        stopped = interrupted_after(6)
        patched.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: stopped)
        assert abhv_mc(f"run {campaign} -o {address}")[0] == 3
    flights = {name for name in names(store, base) if name.startswith("flights/")}
    assert flights and manifest_of(store, base)["state"] == "interrupted"
    code, out, _ = abhv_mc(f"run {campaign} -o {address}")
    assert code == 0 and f"folder    {address}" in out
    stored = names(store, base)
    assert flights < stored and {"report.html", "envelopes.parquet", "samples.parquet"} < stored
    assert not any(
        name.startswith("envelope_states") or name.endswith((".temporary", ".lock"))
        for name in stored
    )
    reference = json.loads((tmp_path / "whole/manifest.json").read_text())
    assert manifest_of(store, base)["digest"] == reference["digest"]
    code, out, _ = abhv_mc("query", address, "select count(*) as n from flights", "--json", "-")
    assert (code, json.loads(out)) == (0, [{"n": 600}])
    code, out, _ = abhv_mc(f"runs {address} --json -")
    status = json.loads(out)
    assert (status["folder"], status["runs_done"], status["holder"]) == (address, 300, None)
    assert status["bytes"] > 50_000
    assert abhv_mc(f"verify campaign {address}")[0] == 0
    assert (
        abhv_mc(f"query {address} --csv {tmp_path / 'csv'}")[0] == 0
        and (tmp_path / "csv/flights.csv").is_file()
    )
    assert abhv_mc("query", address)[0] == 2
    code, out, _ = abhv_mc("runs", address.replace("/first", "/"), "--json", "-")
    assert [(row["folder"], row["flights"]) for row in json.loads(out)] == [("first", 300)]
    code, out, _ = abhv_mc(f"report {address} -o {tmp_path / 'here'}")
    assert (
        code == 0
        and (tmp_path / "here/report.html").is_file()
        and list((tmp_path / "here/figures").iterdir())
    )


def test_shards_at_addresses_merge(bucket, abhv_mc, tmp_path):
    _, address, _ = bucket
    campaign, (before, _, after) = write_campaign(tmp_path / "f"), address.partition("first")
    parts = [f"{before}part{i}{after}" for i in (1, 2)]
    for i, shard in enumerate(parts, 1):
        code, *_ = abhv_mc(
            "run", campaign, "-o", shard, "--shard", f"{i}/2", "--staging", tmp_path / "staging"
        )
        assert code == 0 and not list((tmp_path / "staging").iterdir())
    assert abhv_mc("merge", *parts, "-o", tmp_path / "whole", "--no-report")[0] == 0
    assert json.loads((tmp_path / "whole/manifest.json").read_text())["runs_done"] == 300


@pytest.mark.parametrize("name", ["flights/../../planted", "/planted"])
def test_an_object_named_outside_the_folder_is_rejected(tmp_path, name):
    """Object names may be any text; one with '..' must not be written outside the folder."""

    class System:
        type_name = "s3"

        def get_file_info(self, selector):
            return [fs.FileInfo(f"{selector.base_dir}/{name}", fs.FileType.File)]

        def open_input_stream(self, path):
            raise AssertionError("read")

    (tmp_path / "a/b").mkdir(parents=True)
    with pytest.raises(InputError, match="points outside"):
        remote.Remote(
            Objects(Address("s3://bucket/first"), System(), "bucket/first"), tmp_path / "a/b"
        ).pull()
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "b"]


def test_flights_are_copied_during_the_run(bucket, monkeypatch):
    """Files are copied during the run, so that a lost machine costs only the last ones."""
    store, address, base = bucket
    with open_store(Path(address)).writing() as folder:
        (folder / "flights").mkdir()
        (folder / "flights/one.parquet").write_bytes(b"rows")
        (folder / "manifest.json").write_text("{}")
        landed = threading.Event()
        for _ in range(200):
            if {"flights/one.parquet", "manifest.json"} <= names(store, base):
                landed.set()
                break
            landed.wait(0.05)
        assert landed.is_set()
        with (
            pytest.raises(InputError, match=r" \d+ s "),
            open_store(Path(address)).writing(),
        ):
            pass
        monkeypatch.setattr(remote, "LEASE", -60.0)  # as if the process had ended a minute ago
        with open_store(Path(address)).writing():
            pass
        (folder / "flights/one.parquet").unlink()
    assert names(store, base) == {"manifest.json"} and not folder.exists()


def test_a_writer_without_its_lease_stops_writing(bucket, tmp_path, monkeypatch, capfd):
    store, address, base = bucket
    monkeypatch.setattr(remote, "RENEWAL", 0.1)

    def fly_on():
        with open_store(Path(address)).writing(tmp_path / "staging") as folder:
            (folder / "manifest.json").write_text("{}")
            monkeypatch.setattr(remote, "read_holder", lambda _: ("process 7 on other", "another"))
            try:
                for _ in range(600):  # until interrupted
                    threading.Event().wait(0.1)
            finally:
                (folder / "late.json").write_text("{}")

    with pytest.raises(StorageFullError, match=str(tmp_path / "staging")):
        fly_on()
    assert "process 7 on other" in capfd.readouterr().err
    (copy,) = (tmp_path / "staging").iterdir()
    assert (copy / "copy/late.json").exists()
    assert "late.json" not in names(store, base)


def test_files_are_local(tmp_path):
    assert open_store(Path(f"file://{tmp_path}")).local == tmp_path
    with open_store(tmp_path).reading() as folder:
        assert folder == tmp_path
