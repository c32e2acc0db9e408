"""Samples read back are those that were written, whoever reads what at the same time."""

import sys
import threading

import numpy as np
import pytest

from abhv_mc.folder import samples
from abhv_mc.folder.samples import SampleReader, write_samples

NAMES = ("aero.lift", "aero.drag")


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setattr(samples, "ROW_GROUP", 64)
    write_samples(tmp_path / "samples.parquet", NAMES, 1000, draw, {})
    return tmp_path / "samples.parquet"


def draw(first, stop):
    return np.arange(first, stop)[:, None] + np.array([0.0, 0.25])


def test_rows_across_groups(path):
    reader = SampleReader(path)
    for first, stop in [(0, 1), (60, 70), (0, 1000), (999, 1000), (5, 5)]:
        np.testing.assert_array_equal(reader.rows(first, stop), draw(first, stop))


def test_threads_in_different_groups_get_their_own_rows(path):
    """Blocks take off in one thread and land in another, at a group's edge in two groups."""
    reader, wrong = SampleReader(path), []
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)

    def read(first):
        for _ in range(3000):
            if not np.array_equal(reader.rows(first, first + 16), draw(first, first + 16)):
                wrong.append(first)

    threads = [threading.Thread(target=read, args=(first,)) for first in (48, 64, 512, 0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    sys.setswitchinterval(interval)
    assert not wrong
