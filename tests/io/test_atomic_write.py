"""A file gets to its place whole or not at all, and follows no link that somebody laid there."""

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from abhv_mc.io.atomic_write import ASIDE, atomic_write


def test_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a/b.txt"
    with atomic_write(path, durable=True) as aside:
        aside.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    with pytest.raises(TypeError), atomic_write(path) as aside:
        aside.write_text(3)
    assert path.read_text() == "new" and list(path.parent.iterdir()) == [path]


def test_a_folder_is_not_replaced(tmp_path, monkeypatch):
    """Nor is it an error of Python's that some of them have no name."""
    monkeypatch.chdir(tmp_path)
    for place in (".", "..", "/", tmp_path):
        with pytest.raises(OSError), atomic_write(Path(place)) as aside:  # noqa: PT011  of several kinds
            aside.write_text("new")
    assert not any(tmp_path.iterdir())


def test_a_name_with_a_colon_is_a_name(tmp_path, monkeypatch):
    """pyarrow took `run:1/x.parquet` for an address."""
    monkeypatch.chdir(tmp_path)
    table = pa.table({"a": [1]})
    with atomic_write(Path("run:1/x.parquet")) as aside:
        pq.write_table(table, aside)
    assert pq.read_table(tmp_path / "run:1/x.parquet").equals(table)


def test_no_link_is_followed(tmp_path, monkeypatch):
    """Neither at the name of the file, nor, by one who guesses it, at that of the one beside it."""
    victim, path = tmp_path / "victim", tmp_path / "b.txt"
    victim.write_text("kept")
    path.symlink_to(victim)
    with atomic_write(path) as aside:
        aside.write_text("new")
    assert victim.read_text() == "kept" and path.read_text() == "new" and not path.is_symlink()
    monkeypatch.setattr("secrets.token_hex", lambda size: "guessed")
    (tmp_path / f".b.txt.guessed{ASIDE}").symlink_to(victim)
    with pytest.raises(FileExistsError), atomic_write(path) as aside:
        aside.write_text("evil")
    assert victim.read_text() == "kept"
    (tmp_path / f".b.txt.guessed{ASIDE}").unlink()
    with atomic_write(path) as aside:
        assert os.lstat(aside).st_nlink == 1
        aside.write_text("newer")
    assert path.read_text() == "newer"


def test_what_is_written_has_the_rights_of_any_file(tmp_path):
    with atomic_write(tmp_path / "a") as aside:
        aside.write_bytes(b"")
    (tmp_path / "b").touch()
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode
