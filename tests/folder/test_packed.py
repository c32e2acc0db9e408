"""Arrays of a file of anybody's: what nobody asks for is not unpacked, and nothing larger than its header allows."""

import io
import zipfile

import numpy as np
import pytest

from abhv_mc.folder import packed
from abhv_mc.folder.packed import open_packed


def write(path, members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members.items():
            file.writestr(name, content)


def npy(values):
    content = io.BytesIO()
    np.save(content, values, allow_pickle=True)
    return content.getvalue()


def header(shape, kind="'<f8'"):
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\x00v\x00" + text.encode().ljust(117) + b"\n"


def test_arrays_come_back(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", x=np.arange(5.0), word=np.asarray("ab"), empty=np.empty((0, 3)))
    with open_packed(tmp_path / "a.npz") as stored:
        assert sorted(stored) == ["empty", "word", "x"] and len(stored) == 3
        assert stored["x"].tolist() == list(range(5)) and stored["word"] == "ab" and stored["empty"].shape == (0, 3)


def test_what_nobody_asks_for_is_not_unpacked(tmp_path, monkeypatch):
    write(tmp_path / "a.npz", {"x.npy": npy(np.arange(3)), "bomb.npy": bytes(2**22), "evil.npy": npy(np.array([{}]))})
    opened = []
    whole = zipfile.ZipFile.open
    monkeypatch.setattr(
        zipfile.ZipFile,
        "open",
        lambda self, member, *more: opened.append(member.filename) or whole(self, member, *more),
    )
    with open_packed(tmp_path / "a.npz") as stored:
        assert stored["x"].tolist() == [0, 1, 2]
    assert set(opened) == {"x.npy"}


@pytest.mark.parametrize(
    "content",
    [
        header("(999999999999,)"),
        header("(99999999999, 99999999999)"),
        header("(-1,)"),
        header("(1,)", "'|O'"),
        header("(1,)", "'<U999999999'"),
        header("(1,)", "[('a', '<f8')]"),
        header("(1,)") + bytes(2**20),
        header("(4,)") + bytes(8),
        b"\x93NUMPY\x07\x00",
        b"",
    ],
)
def test_headers_that_promise_too_much_or_something_else(tmp_path, monkeypatch, content):
    """Refused before anything is unpacked."""
    monkeypatch.setattr(packed, "MAX_BYTES", 2**16)
    write(tmp_path / "a.npz", {"x.npy": content})
    with (
        open_packed(tmp_path / "a.npz") as stored,
        pytest.raises(ValueError, match=r"^x: |header|magic|reshape|array|dtype"),
    ):
        stored["x"]


def test_all_arrays_together_have_a_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(packed, "MAX_BYTES", 2**16)
    write(tmp_path / "a.npz", {f"{k}.npy": npy(np.zeros(4000)) for k in range(3)})
    with open_packed(tmp_path / "a.npz") as stored:
        assert stored["0"].size == stored["1"].size == 4000
        with pytest.raises(ValueError, match="more than 65536 bytes"):
            stored["2"]


def test_other_ways_of_packing_are_refused(tmp_path):
    write(tmp_path / "a.npz", {"x.npy": npy(np.zeros(9))}, zipfile.ZIP_LZMA)
    with open_packed(tmp_path / "a.npz") as stored, pytest.raises(ValueError, match="another way"):
        stored["x"]
