"""Leases of folders at addresses, by the store's clock, and secrecy of keys in addresses.

A key must not appear in logs, reports or manifests, which may be shown to others.
"""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_flight import write_campaign
from pyarrow import fs

from abhv_mc.io.address import Address
from abhv_mc.io.messages import InputError
from abhv_mc_remote import store as remote
from abhv_mc_remote.store import LEASE, LEASE_NAME, Lease, Objects, Remote, read_holder


class DatedStore(Objects):
    """Store in memory whose clock is set by the test."""

    def __init__(self):
        super().__init__(Address("s3://bucket/folder"), fs._MockFileSystem(), "bucket/folder")
        self.now, self.dates = datetime(2030, 1, 1, tzinfo=UTC), {}

    def write(self, name, content):
        super().write(name, content)
        self.dates[name] = self.now

    def ages(self, *names):
        return [self.dates[name] if name in contents(self.system) else None for name in names]

    def wait(self, seconds):
        self.now += timedelta(seconds=seconds)


def contents(system):
    """Return the contents of all objects by name."""
    objects = system.get_file_info(fs.FileSelector("bucket", recursive=True, allow_not_found=True))
    files = [info.path for info in objects if info.type == fs.FileType.File]
    return {
        path.removeprefix("bucket/folder/"): system.open_input_stream(path).read() for path in files
    }


@pytest.fixture
def store(monkeypatch):
    monkeypatch.setattr(remote, "_SETTLE", 0.0)
    return DatedStore()


def take(store):
    lease = Lease(store)
    lease.take()
    return lease


def test_a_lease_is_valid_while_renewed_and_until_dropped(store):
    first = take(store)
    for _ in range(3):
        store.wait(0.9 * LEASE)
        first.renew()
        with pytest.raises(InputError, match=rf" {LEASE:g} s "):
            take(store)
    assert list(contents(store.system)) == [LEASE_NAME]  # rejected processes leave no objects
    first.drop()
    assert read_holder(store) is None
    take(store).drop()


def test_an_expired_lease_is_taken_over_and_its_loser_stops_writing(store, tmp_path):
    first = take(store)
    store.wait(1.1 * LEASE)
    second = take(store)
    stored = contents(store.system)
    (tmp_path / "manifest.json").write_text("{}")
    for write in (first.renew, Remote(store, tmp_path, first).push):
        with pytest.raises(InputError, match=rf" {LEASE:g} s "):
            write()
    first.drop()
    assert contents(store.system) == stored
    second.renew()
    second.drop()


def test_the_later_of_two_simultaneous_writers_has_the_lease(store, monkeypatch):
    other = Lease(store)
    monkeypatch.setattr(remote.time, "sleep", lambda _: other._write())
    with pytest.raises(InputError, match=rf" {LEASE:g} s "):
        take(store)


@pytest.mark.parametrize("content", [b"", b"{}", b"\xff", b"[1]"])
def test_an_unreadable_lease_belongs_to_another_process(store, content):
    store.write(LEASE_NAME, content)
    with pytest.raises(InputError, match=rf" {LEASE:g} s "):
        take(store)


def test_a_key_is_never_written(store, fake_engine, abhv_mc, tmp_path, monkeypatch):
    url, opened = "s3://KEYID:SECRET@bucket/folder?region=x", []
    monkeypatch.setattr(remote, "PUSH_INTERVAL", 0.05)
    opens = SimpleNamespace(
        from_uri=lambda uri: opened.append(uri) or (store.system, "bucket/folder")
    )
    stub = SimpleNamespace(FileSystem=opens, FileSelector=fs.FileSelector, FileType=fs.FileType)
    monkeypatch.setattr("abhv_mc_remote.store.pyarrow_fs", stub)
    campaign = write_campaign(tmp_path / "f")
    answers = [
        abhv_mc("run", campaign, "--runs", 64, f"--output={url}", "--json", tmp_path / "run.json")
    ]
    stored = contents(store.system)
    assert {"manifest.json", "report.html"} < set(stored)
    answers += [abhv_mc(f"runs {url} --json -"), abhv_mc(f"verify campaign {url}")]
    answers.append(abhv_mc(f"run {campaign} --runs 80 --no-report -o {url}"))

    def refuse(self, name, content, write=Objects.write):
        if not name.startswith(LEASE_NAME):
            raise OSError(f"the bucket of {url} is gone")
        write(self, name, content)

    monkeypatch.setattr(Objects, "write", refuse)
    answers.append(abhv_mc(f"run {campaign} --runs 96 --no-report -o {url}"))
    assert [code for code, *_ in answers] == [0, 0, 0, 0, 3]
    local = Path(re.search(r"kept in (\S+):", answers[-1][2])[1])
    assert '"runs_done": 96' in (local / "manifest.json").read_text()
    written = [
        path.read_bytes() for path in (*tmp_path.rglob("*"), *local.rglob("*")) if path.is_file()
    ]
    masked = "s3://...@bucket/folder?region=x"
    assert masked.encode() in stored["manifest.json"] and masked in answers[0][1]
    assert not any(b"SECRET" in content for content in [*stored.values(), *written])
    assert not any("SECRET" in text for _, *streams in answers for text in streams)
    assert set(opened) == {url}


@pytest.mark.parametrize(
    "command",
    ["report {}", "report x {}", "run {}", "run x.yaml -o {} "
                                           "--nonsense", "run x.yaml --plans {}", "new {}", "{}",
     "validate {}", "runs {}", "merge {} {} -o x", "replay {} --flight 1", "fly x --output={}"],
)  # fmt: skip
def test_a_key_is_not_printed_by_errors(command, abhv_mc):
    """Errors of usage, of invalid addresses and of missing folders do not print the key."""
    address = "s3://KEYID:SECRET/+@bucket/folder"
    code, *streams = abhv_mc(*command.format(address, address).split())
    assert code == 2 and not any("SECRET" in text for text in streams)
