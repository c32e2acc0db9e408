import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.spread import PROCESSES, Spread, find_spreads, make_note, make_parser, repeat

MACHINE = {"processor": "CPU", "simd": "AVX2", "cores": 2, "load_before": 0.25}


def test_every_quantity_has_its_median_and_ends():
    runs = [{"a": 2.0, "b": 7.0}, {"a": 9.0, "b": 5.0}, {"a": 1.0, "b": 6.0}]
    assert find_spreads(runs) == {"a": Spread(2.0, 1.0, 9.0), "b": Spread(6.0, 5.0, 7.0)}


def write_module(folder, monkeypatch, code):
    (folder / "measured.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(folder))


def test_every_run_is_a_process_of_its_own(tmp_path, monkeypatch):
    write_module(tmp_path, monkeypatch, "import json, os, sys; print(json.dumps([os.getpid(), *sys.argv[1:]]))")
    runs = repeat(3, "measured", "--once")
    assert len({pid for pid, _ in runs}) == 3
    assert [word for _, word in runs] == ["--once"] * 3


def test_a_process_that_fails_stops_the_measurement(tmp_path, monkeypatch):
    write_module(tmp_path, monkeypatch, "print('1'); raise SystemExit(3)")
    with pytest.raises(subprocess.CalledProcessError):
        repeat(3, "measured")


def test_the_note_says_how_many_processes_there_were():
    assert make_note(MACHINE, 3) == "CPU, AVX2, 2 cores, load 0.2 before the start; medians of 3 processes."
    assert make_note(MACHINE, 1).endswith("; one process.")


def test_three_processes_unless_told_otherwise():
    parser = make_parser("What it does.", Path("result.json"))
    assert PROCESSES >= 3  # what the page promises of its numbers
    assert parser.parse_args([]).processes == PROCESSES
    assert parser.parse_args(["--processes", "5"]).processes == 5


@pytest.mark.parametrize("count", ["0", "-1", "many"])
def test_no_process_is_no_measurement(count, capsys):
    with pytest.raises(SystemExit):
        make_parser("What it does.", Path("result.json")).parse_args([f"--processes={count}"])
    assert "--processes" in capsys.readouterr().err


def test_what_measures_memory_loads_no_library_of_the_measured_processes():
    code = "import sys, benchmarks.growth, benchmarks.limit; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "False"
