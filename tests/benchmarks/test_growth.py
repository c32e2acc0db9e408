import sys
import threading

import numpy as np
import pytest

from abhv_mc.campaign.file.check import read_campaign
from benchmarks import growth, processes
from benchmarks.growth import QUANTITIES, SHORT, fit_line, make_table, write_short_campaign
from benchmarks.spread import Spread

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


def test_the_table_says_the_slope_in_the_unit_of_a_flight():
    found = {name: [3.0 + 2e-3 * n for n in FLIGHTS] for name in QUANTITIES}
    table = make_table(FLIGHTS, found, {name: fit_line(FLIGHTS, values) for name, values in found.items()}, "where")
    assert "| 100,000 | 203 |" in table
    assert "| line | 3 + 2 ms a flight |" in table


def test_every_size_has_the_spread_of_its_own_campaigns(monkeypatch):
    times = iter([3.0, 1.0, 2.0, 30.0, 10.0, 20.0])
    monkeypatch.setattr(growth, "measure", lambda *_: dict.fromkeys(QUANTITIES, next(times)))
    found = growth.measure_all(growth.CAMPAIGN, [100, 1000], "tlc", 3)
    assert found["run_s"] == [Spread(2.0, 1.0, 3.0), Spread(20.0, 10.0, 30.0)]
    assert found.keys() == QUANTITIES.keys()


def test_the_short_campaign_is_the_default_one_but_for_its_length(tmp_path, repository):
    short = read_campaign(write_short_campaign(tmp_path)).model
    default = read_campaign(repository / "campaigns" / "s_manoeuvre.yaml").model
    assert f"duration: {SHORT} s\n" in short.mission.read_text(encoding="utf-8")
    assert short.vehicle.resolve() == default.vehicle.resolve()
    assert short.dispersions == default.dispersions


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


def test_a_command_that_fails_is_told(tmp_path):
    with pytest.raises(RuntimeError, match="abhv-mc report"):
        processes.run_command("report", str(tmp_path / "nothing"))
