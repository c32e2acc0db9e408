import sys
import threading

import numpy as np
import pytest

from benchmarks import processes
from benchmarks.growth import fit_line

FLIGHTS = [100, 1000, 10_000, 100_000]


def test_a_line_is_found_again_at_both_ends():
    line = fit_line(FLIGHTS, [3.0 + 2e-3 * n for n in FLIGHTS])
    assert line["intercept"] == pytest.approx(3.0, rel=1e-9)  # the largest campaign does not drown the smallest
    assert line["slope"] == pytest.approx(2e-3, rel=1e-9)
    assert line["largest_deviation"] < 1e-9


def test_the_deviation_is_a_share_of_the_line():
    values = [3.0 + 2e-3 * n for n in FLIGHTS]
    values[1] *= 1.5
    line = fit_line(FLIGHTS, values)
    fitted = np.array([line["intercept"] + line["slope"] * n for n in FLIGHTS])
    assert line["largest_deviation"] == pytest.approx(np.max(np.abs(values / fitted - 1.0)), rel=1e-12)
    assert line["largest_deviation"] > 0.1


def test_memory_counts_the_processes_that_a_process_starts(monkeypatch):
    hold = "import sys; held = bytearray(b'x') * 40_000_000; print(flush=True); sys.stdin.read()"
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {hold!r}])"
    monkeypatch.setattr(processes, "INTERVAL", 0.01)
    ended, found = threading.Event(), []
    with processes.subprocess.Popen(
        [sys.executable, "-c", parent], stdin=processes.subprocess.PIPE, stdout=processes.subprocess.PIPE
    ) as process:
        process.stdout.readline()  # the child holds its memory
        watch = threading.Thread(target=processes._watch_memory, args=(process.pid, ended, found))
        watch.start()
        while len(found) < 3 and watch.is_alive():
            ended.wait(0.01)
        ended.set()
        watch.join()
        process.communicate()
    assert max(found) > 40.0
