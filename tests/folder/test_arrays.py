"""Arrays with a checksum."""

import numpy as np
import pytest

from abhv_mc.folder.arrays import read_array, write_array


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int64])
def test_blocks_are_stored_one_after_the_other(tmp_path, kind):
    blocks = [np.arange(6, dtype=kind).reshape(3, 2), np.empty((0, 2), kind), np.ones((1, 2), kind)]
    blocks[0] = np.asfortranarray(blocks[0])
    write_array(tmp_path / "a.npy", *blocks)
    stored = read_array(tmp_path / "a.npy")
    assert stored.dtype == kind and np.array_equal(stored, np.concatenate(blocks))


def test_damaged_arrays_are_none(tmp_path):
    path = tmp_path / "a.npy"
    assert read_array(path) is None
    write_array(path, np.arange(5.0))
    content = path.read_bytes()
    for changed in (content[:-1], content[:-5], content[:40] + b"?" + content[41:], b""):
        path.write_bytes(changed)
        assert read_array(path) is None
    path.write_bytes(content)
    assert read_array(path).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
