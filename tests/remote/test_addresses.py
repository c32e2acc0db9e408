"""Who flies in a folder, the holder of its lock; and at an address, that of a lease by the store's clock. A key in an
address goes to the store and nowhere else: logs, reports and manifests are kept, and shown to others."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_flight import write_campaign
from pyarrow import fs

from abhv_mc.io.address import Address
from abhv_mc.io.input_error import InputError
from abhv_mc_remote import objects as module
from abhv_mc_remote import store as remote
from abhv_mc_remote.objects import LEASE, LEASE_NAME, Lease, Objects, read_holder
from abhv_mc_remote.store import Remote


class DatedStore(Objects):
    """In memory, dated by a clock that stands still until it is moved."""

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
    """All objects by name."""
    found = system.get_file_info(fs.FileSelector("bucket", recursive=True, allow_not_found=True))
    files = [info.path for info in found if info.type == fs.FileType.File]
    return {
        path.removeprefix("bucket/folder/"): system.open_input_stream(path).read() for path in files
    }


@pytest.fixture
def store(monkeypatch):
    monkeypatch.setattr(module, "_SETTLE", 0.0)
    return DatedStore()


def take(store):
    lease = Lease(store)
    lease.take()
    return lease


def test_a_lease_holds_while_it_is_renewed_and_until_it_is_dropped(store):
    first = take(store)
    for _ in range(3):
        store.wait(0.9 * LEASE)
        first.renew()
        with pytest.raises(InputError, match="is flying"):
            take(store)
    assert list(contents(store.system)) == [LEASE_NAME]  # nothing is left of those who asked
    first.drop()
    assert read_holder(store) is None
    take(store).drop()


def test_a_lease_that_nobody_renews_is_taken_over_and_its_loser_writes_nothing_more(
    store, tmp_path
):
    first = take(store)
    store.wait(1.1 * LEASE)
    second = take(store)
    held = contents(store.system)
    (tmp_path / "manifest.json").write_text("{}")
    for write in (first.renew, Remote(store, tmp_path, first).push):
        with pytest.raises(InputError, match="is flying"):
            write()
    first.drop()
    assert contents(store.system) == held
    second.renew()
    second.drop()


def test_of_two_that_find_none_the_later_writer_has_it(store, monkeypatch):
    other = Lease(store)
    monkeypatch.setattr(module.time, "sleep", lambda _: other._write())
    with pytest.raises(InputError, match="is flying"):
        take(store)


@pytest.mark.parametrize("content", [b"", b"{}", b"\xff", b"[1]"])
def test_an_object_that_is_no_lease_is_somebodys(store, content):
    store.write(LEASE_NAME, content)
    with pytest.raises(InputError, match="another process is flying"):
        take(store)


def test_a_key_is_written_nowhere(store, fake_engine, abhv_mc, tmp_path, monkeypatch):
    at, opened = "s3://KEYID:SECRET@bucket/folder?region=x", []
    monkeypatch.setattr(remote, "PUSH_INTERVAL", 0.05)
    opens = SimpleNamespace(
        from_uri=lambda uri: opened.append(uri) or (store.system, "bucket/folder")
    )
    known = SimpleNamespace(FileSystem=opens, FileSelector=fs.FileSelector)
    monkeypatch.setattr("abhv_mc_remote.objects.pyarrow_fs", known)
    campaign = write_campaign(tmp_path / "f")
    said = [
        abhv_mc("run", campaign, "--runs", 64, f"--output={at}", "--json", tmp_path / "run.json")
    ]
    held = contents(store.system)
    assert {"manifest.json", "report.html"} < set(held)
    said += [abhv_mc("runs", at, "--json", "-"), abhv_mc("verify", "campaign", at)]
    said.append(abhv_mc("run", campaign, "--runs", 80, "--no-report", "-o", at))

    def refuse(self, name, content, write=Objects.write):
        if not name.startswith(LEASE_NAME):
            raise OSError(f"the bucket of {at} is gone")
        write(self, name, content)

    monkeypatch.setattr(Objects, "write", refuse)
    said.append(abhv_mc("run", campaign, "--runs", 96, "--no-report", "-o", at))
    assert [code for code, *_ in said] == [0, 0, 0, 0, 3]
    kept = Path(re.search(r"What was flown is kept in (\S+):", said[-1][2])[1])
    assert '"runs_done": 96' in (kept / "manifest.json").read_text()
    written = [
        path.read_bytes() for path in (*tmp_path.rglob("*"), *kept.rglob("*")) if path.is_file()
    ]
    masked = "s3://...@bucket/folder?region=x"
    assert masked.encode() in held["manifest.json"] and masked in said[0][1]
    assert not any(b"SECRET" in content for content in [*held.values(), *written])
    assert not any("SECRET" in words for _, *streams in said for words in streams)
    assert set(opened) == {at}


@pytest.mark.parametrize(
    "words",
    ["report {}", "report x {}", "run {}", "run x.yaml -o {} --nonsense", "run x.yaml --plans {}", "new {}", "{}",
     "validate {}", "runs {}", "merge {} {} -o x", "replay {} --flight 1", "fly x --output={}"],
)  # fmt: skip
def test_a_key_is_repeated_by_no_error(words, abhv_mc):
    """Of the usage, of what is no address (a slash of a key is %2F in one), of what has no such folder."""
    address = "s3://KEYID:SECRET/+@bucket/folder"
    code, *said = abhv_mc(*words.format(address, address).split())
    assert code == 2 and not any("SECRET" in text for text in said)
