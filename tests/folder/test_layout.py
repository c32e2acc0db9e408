"""Files of a results folder: what is written, deleted and recorded."""

import errno
import hashlib

import pytest

from abhv_mc.folder import layout
from abhv_mc.folder.layout import (
    TEMPORARY,
    CampaignFolder,
    StorageFullError,
    append_log,
    explain_os_error,
    recording,
    write_bytes,
    write_text,
)
from abhv_mc.io.messages import InputError


def test_a_cleared_folder_keeps_files_of_the_user(tmp_path):
    folder, other = CampaignFolder(tmp_path / "out"), tmp_path / "other"
    other.mkdir()
    (other / "precious").touch()
    for path in (folder.manifest, folder.samples, folder.flights / "a", folder.root / "figures/b"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    folder.histories.symlink_to(other)
    mine = [folder.root / "notes.txt", folder.root / "mine/a", folder.lock]
    for path in mine:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    (folder.root / f"x{TEMPORARY}").touch()
    folder.clear()
    assert set(folder.root.rglob("*")) == {*mine, folder.root / "mine"}
    assert (other / "precious").exists()


def test_unfinished_files_are_swept_from_folders_of_the_campaign(tmp_path):
    folder = CampaignFolder(tmp_path)
    swept = [tmp_path / f"a{TEMPORARY}", folder.flights / f"deep/b{TEMPORARY}"]
    kept = [tmp_path / "a", folder.flights / "b", tmp_path / f"mine/c{TEMPORARY}"]
    for path in (*swept, *kept):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    folder.sweep()
    assert [path.exists() for path in (*swept, *kept)] == [False, False, True, True, True]


@pytest.mark.parametrize(
    ("found", "fresh", "fits"),
    [
        (None, False, True),
        ("samples.parquet", False, True),
        ("flights/a.parquet", False, False),
        ("flights/a.parquet", True, True),
        ("flights/a.txt", False, True),
        ("notes.txt", False, False),
        ("notes.txt", True, False),
        (".lock.a", False, True),
        (f"x{TEMPORARY}", False, True),
    ],
)
def test_folders_with_foreign_files_or_flights_are_refused(tmp_path, found, fresh, fits):
    folder = CampaignFolder(tmp_path / "out")
    if found:
        path = folder.root / found
        path.parent.mkdir(parents=True)
        path.touch()
    if fits:
        folder.refuse_foreign_files(fresh)
        return
    with pytest.raises(InputError):
        folder.refuse_foreign_files(fresh)


def test_written_files_are_recorded_with_their_hash_and_may_be_programs(tmp_path):
    noted, path = [], tmp_path / "a"
    with recording(lambda *entry: noted.append(entry)):
        write_text(path, "\u03b1")
        write_bytes(tmp_path / "b", b"xy", executable=True)
    write_text(tmp_path / "c", "later")
    contents = {path: "\u03b1".encode(), tmp_path / "b": b"xy"}
    hashes = {file: hashlib.sha256(content).hexdigest() for file, content in contents.items()}
    assert dict(noted) == hashes and len(noted) == 2
    modes = [(tmp_path / name).stat().st_mode & 0o777 for name in "ab"]
    assert modes[0] & 0o111 == 0 and modes[1] == modes[0] | (modes[0] & 0o444) >> 2
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError):
        write_text(tmp_path / "folder", "")


@pytest.mark.parametrize(
    ("number", "writing", "kind"),
    [
        (errno.ENOSPC, False, StorageFullError),
        (errno.ENOSPC, True, StorageFullError),
        (errno.EACCES, False, InputError),
        (errno.ENOENT, True, InputError),
        (errno.ENOENT, False, FileNotFoundError),
        (errno.EIO, True, OSError),
    ],
)
def test_errors_of_the_disk_name_the_path(tmp_path, number, writing, kind):
    with pytest.raises(kind) as caught, explain_os_error(tmp_path / "x", writing=writing):
        raise OSError(number, "x")
    assert type(caught.value) is kind


def test_a_log_ends_at_its_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(layout, "_LARGEST_LOG", 22)
    for text in ("one\n\n", "two", "three"):
        append_log(tmp_path / "log", "head", text)
    assert (tmp_path / "log").read_text() == "== head\none\n== head\ntwo\n"
