"""Guard of reads in the process of a user's simulator."""

import importlib.util
import json
import os
import shutil
import sys
import time

import pytest
from programs import run_python

from abhv_mc.custom_code.read_guard import ReadGuard
from abhv_mc.external_simulators import python_lines

HEAD = """
import ctypes, importlib.util, io, mmap, os, pathlib, pickle, runpy, sqlite3, subprocess, sys
import numpy as np

STUDY = {study!r}
def at(name):
    return os.path.join(STUDY, name)

def fly(inputs, settings):
    return {{"total": float(WAYS[inputs["way"]]() or 0.0)}}

WAYS = {{
"""
# Ways of reading that are not declared, by name; ``model.*`` lies beside the simulator, ``up.*``
# one folder up.
UNDECLARED = {
    "open": "lambda: open(at('model.txt')).read()",
    "bytes": "lambda: open(os.fsencode(at('model.txt'))).read()",
    "path": "lambda: pathlib.Path(at('model.txt')).read_text()",
    "a+": "lambda: open(at('model.txt'), 'a+').seek(0)",
    "r+b": "lambda: open(at('model.txt'), 'r+b').read()",
    "os.open": "lambda: os.read(os.open(at('model.txt'), os.O_RDONLY), 9)",
    "open_code": "lambda: io.open_code(at('model.txt')).read()",
    "numpy": "lambda: np.loadtxt(at('model.txt'))",
    "memmap": "lambda: np.memmap(at('model.txt'), np.uint8, 'r')[0]",
    "link": "lambda: (os.symlink(at('model.txt'), 'l'), open('l').read())[1]",
    "one folder up": "lambda: open(at('../up.txt')).read()",
    "module": "lambda: (sys.path.append(STUDY), importlib.import_module('model').K)[1]",
    "module one folder up": "lambda: (sys.path.append(at('..')), "
    "importlib.import_module('up').K)[1]",
    "spec": "lambda: runpy.run_path(at('model.py'))['K']",
    "CDLL": "lambda: ctypes.CDLL(at('libmodel.so')) and 1",
    "sqlite3": "lambda: sqlite3.connect(at('model.db')) and 1",
    "subprocess": "lambda: subprocess.check_output(['cat', at('model.txt')])",
    "subprocess in a folder": "lambda: subprocess.check_output(['cat', 'model.txt'], cwd=STUDY)",
    "shell": "lambda: subprocess.check_output('cat <' + at('model.txt'), shell=True)",
    "popen": "lambda: os.popen('cat ' + at('model.txt')).read()",
    "system": "lambda: os.system('cat ' + at('model.txt'))",
    "spawn": "lambda: os.posix_spawn('/bin/cat', ['cat', at('model.txt')], os.environ)",
    "program": "lambda: subprocess.check_output([at('model.sh')])",
    "program in the home": "lambda: subprocess.check_output([os.path.expanduser('~/solver.sh')])",
    "program of a shell": "lambda: os.popen('~/solver.sh 2 || false').close()",
    "pyarrow": "lambda: __import__('pyarrow.csv').csv.read_csv('model.txt').num_rows + 1",
}
# Ways that real simulators use.
DECLARED = {
    "declared": "lambda: open('gains.txt').read()",
    "declared original": "lambda: open(at('gains.txt')).read()",
    "module": "lambda: importlib.import_module('helper').K",
    "own output": "lambda: (open('case.in', 'w').write('2'), open('case.in').read())[1]",
    "output of a child": "lambda: (os.system('echo 2 > case.out'), open('case.out').read())[1]",
    "scratch of a child": "lambda: (os.system(f'echo 2 > {SCRATCH}/x'), open(SCRATCH + "
    "'/x').read())[1]",
    "libc": "lambda: ctypes.CDLL('libc.so.6') and 2",
    "loaded program": "lambda: ctypes.CDLL(None) and 2",
    "settings": "lambda: open(os.path.expanduser('~/.config/solver.rc')).read()",
    "system": "lambda: len(open('/proc/self/maps').read())",
    "database in memory": "lambda: sqlite3.connect(':memory:').execute('select 2').fetchone()[0]",
    "folder": "lambda: len(os.listdir(STUDY))",
    "program": "lambda: subprocess.check_output(['./solver.sh', '2'])",
    "program elsewhere": "lambda: subprocess.check_output([TOOLS + '/solver.sh', '2'])",
    "scipy": "lambda: __import__('scipy.optimize').optimize.brentq(lambda x: x - 2, 0, 5)",
    "pandas": "lambda: __import__('pandas').read_csv('gains.txt', header=None).size",
    "matplotlib": "lambda: (__import__('matplotlib.pyplot').pyplot.figure().savefig('x.png'), "
    "2)[1]",
    "pyarrow": "lambda: __import__('pyarrow.csv').csv.read_csv('gains.txt').num_rows + 1",
    "numba": "lambda: __import__('numba').njit(cache=True)"
    "(importlib.import_module('helper').twice)(1)",
}


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A simulator's folder with declared and undeclared files."""
    folder = tmp_path / "up" / "study"
    folder.mkdir(parents=True)
    for name in ("model.txt", "gains.txt", "../up.txt"):
        (folder / name).write_text("2\n")
    for name in ("model.py", "../up.py"):
        (folder / name).write_text("K = 2\n")
    (folder / "helper.py").write_text("K = 2\n\ndef twice(x):\n    return 2 * x\n")
    for name in ("model.sh", "solver.sh"):
        (folder / name).write_text("#!/bin/sh\necho 2\n")
        (folder / name).chmod(0o755)
    for name in ("libmodel.so", "model.db"):
        (folder / name).write_bytes(b"")
    for place in ("home", "tools"):
        (tmp_path / place).mkdir()
        shutil.copy(folder / "solver.sh", tmp_path / place / "solver.sh")
    settings = tmp_path / "home" / ".config" / "solver.rc"
    settings.parent.mkdir(parents=True)
    settings.write_text("2")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return folder


def fly_ways(study, own, ways):
    """Run one flight for each way of reading in the folder ``own``; return the answers."""
    declared = ["sim.py", "gains.txt", "helper.py", "solver.sh"]
    scratch = study.parents[1] / "scratch"
    scratch.mkdir(exist_ok=True)
    body = "".join(f"{name!r}: {code},\n" for name, code in ways.items())
    constants = f"SCRATCH, TOOLS = {str(scratch)!r}, {str(scratch.with_name('tools'))!r}\n"
    (study / "sim.py").write_text(f"{constants}{HEAD.format(study=str(study))}{body}}}\n")
    if own != study:
        for name in declared:
            shutil.copy(study / name, own / name)
    time.sleep(0.05)  # the process's own files are younger than it
    lines = "".join(
        json.dumps({"inputs": {"way": name}, "settings": {}, "flight": name}) + "\n"
        for name in ways
    )
    program = "-P", python_lines.__file__, "sim.py", study, study
    run = run_python(*program, *declared, cwd=own, input=lines, check=True)
    ready, *answers = map(json.loads, run.stdout.splitlines())
    assert ready == {"ready": True}, (ready, run.stderr)
    return dict(zip(ways, answers, strict=True))


@pytest.mark.parametrize("layout", ["in place", "copied"])
def test_undeclared_reads_are_found_and_what_simulators_need_passes(study, tmp_path, layout):
    own = study if layout == "in place" else tmp_path / "own"
    own.mkdir(exist_ok=True)
    answers = fly_ways(study, own, DECLARED)
    assert {way: answer for way, answer in answers.items() if "error" in answer} == {}
    ways = {way: code for way, code in UNDECLARED.items() if way != "pyarrow" or own != study}
    answers = fly_ways(study, own, ways)
    assert {way: answer for way, answer in answers.items() if "error" not in answer} == {}
    missing = {way for way, answer in answers.items() if "PermissionError" not in answer["error"]}
    assert missing <= {"pyarrow"}  # it reports that there is no such file


def test_packages_are_read_below_a_study_and_its_files_are_not(tmp_path):
    study, prefix = tmp_path / "study", tmp_path / "study" / ".venv"
    guard = ReadGuard([], studies=[str(study)], packages=[str(prefix), str(tmp_path)])
    assert guard.allows(os.path.realpath(prefix / "lib" / "package.py"))
    assert not guard.allows(os.path.realpath(study / "model.py"))
    assert guard.allows(os.path.realpath(tmp_path / "elsewhere.py"))
    inside_system = ReadGuard([], studies=["/usr/share/study"], packages=["/usr"])
    assert not inside_system.allows("/usr/share/study/model.py")


def test_compiled_files_below_a_prefix_count_as_their_sources(tmp_path, monkeypatch):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path / "link"))
    guard = ReadGuard([str(tmp_path / "law.py")], studies=[str(tmp_path)], packages=[])
    for name, allowed in (("law.py", True), ("other.py", False)):
        compiled = importlib.util.cache_from_source(str(tmp_path / name))
        assert guard.allows(os.path.realpath(compiled)) is allowed
