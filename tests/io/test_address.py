"""A key in an address goes to the store and nowhere else: logs, reports and manifests are kept, and shown to others."""

from types import SimpleNamespace

import pytest
from fake_flight import write_campaign
from pyarrow import fs

from abhv_mc.folder import lease, remote
from abhv_mc.folder.store import Store

KEY = "KEYID:SECRET"
AT = f"s3://{KEY}@bucket/folder?region=x"
MASKED = "s3://...@bucket/folder?region=x"


@pytest.fixture
def store(monkeypatch):
    """A store in memory, which the address with its key opens."""
    system, opened = fs._MockFileSystem(), []
    monkeypatch.setattr(lease, "_SETTLE", 0.0)
    monkeypatch.setattr(remote, "PUSH_INTERVAL", 0.05)
    opens = SimpleNamespace(from_uri=lambda uri: opened.append(uri) or (system, "bucket/folder"))
    known = SimpleNamespace(FileSystem=opens, FileSelector=fs.FileSelector)
    monkeypatch.setattr("abhv_mc.folder.store.pyarrow_fs", known)
    yield system
    assert set(opened) == {AT}


def contents(system):
    found = system.get_file_info(fs.FileSelector("bucket", recursive=True))
    return {info.path: system.open_input_stream(info.path).read() for info in found if info.size is not None}


def test_a_key_is_written_nowhere(store, fake_engine, abhv_mc, tmp_path, monkeypatch):
    campaign = write_campaign(tmp_path / "f")
    said = [abhv_mc("run", campaign, "--runs", 64, f"--output={AT}", "--json", tmp_path / "run.json")]
    held = contents(store)
    assert {"bucket/folder/manifest.json", "bucket/folder/report.html"} < set(held)
    said += [abhv_mc("status", AT, "--json", "-"), abhv_mc("verify", "campaign", AT)]
    said.append(abhv_mc("run", campaign, "--runs", 80, "--no-report", "-o", AT))

    write = Store.write

    def refuse(self, name, content):
        if not name.startswith(lease.NAME):
            raise OSError(f"the bucket of {AT} is gone")
        write(self, name, content)

    monkeypatch.setattr(Store, "write", refuse)
    said.append(abhv_mc("run", campaign, "--runs", 96, "--no-report", "-o", AT))
    assert [code for code, *_ in said] == [0, 0, 0, 0, 3]
    written = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert MASKED.encode() in held["bucket/folder/manifest.json"] and MASKED in said[0][1]
    assert not any(b"SECRET" in content for content in [*held.values(), *written])
    assert not any("SECRET" in words for _, *streams in said for words in streams)


@pytest.mark.parametrize(
    "words",
    ["report {}", "report x {}", "run {}", "run x.yaml -o {} --nonsense", "run x.yaml --plans {}", "new {}", "{}",
     "validate {}", "list campaigns {}", "merge {} {} -o x", "replay {} --flight 1", "fly x --output={}"],
)  # fmt: skip
def test_a_key_is_repeated_by_no_error(words, abhv_mc):
    """Of the usage, of what is no address (a slash of a key is %2F in one), of what has no such folder."""
    address = "s3://KEYID:SECRET/+@bucket/folder"
    code, *said = abhv_mc(*words.format(address, address).split())
    assert code == 2 and not any("SECRET" in text for text in said)
