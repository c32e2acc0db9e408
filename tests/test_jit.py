"""Where compiled code is kept: never stale, and its making is announced."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import abhv_mc
from abhv_mc import code_cache
from abhv_mc.flight.fly import compiled_flight, fly, nominal_parameters
from abhv_mc.flight.plan import LANES
from abhv_mc.flight.prepare import prepare

PACKAGE = Path(abhv_mc.__file__).parent


@pytest.fixture
def source(tmp_path):
    """A copy of the package's source."""
    skip = shutil.ignore_patterns("__pycache__", "shipped_files")
    return shutil.copytree(PACKAGE, tmp_path / "source" / "abhv_mc", ignore=skip)


def run(code, source, cache):
    environment = {**os.environ, "PYTHONPATH": str(source.parent), "XDG_CACHE_HOME": str(cache)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


LAYERS = [
    *("code_cache.py", "machine_code.py", "jit.py", "jit_compiler.py"),
    *("numerics", "world", "vehicle", "plant", "control", "flight"),
]


@pytest.mark.parametrize("layer", LAYERS)
def test_any_change_to_what_is_compiled_changes_the_folder(source, monkeypatch, layer):
    assert code_cache.source_hash() == code_cache.source_hash()
    before = code_cache.source_hash()
    monkeypatch.setattr(code_cache, "_PACKAGE", source)
    assert code_cache.source_hash() == before  # the place does not matter
    changed = source / layer if layer.endswith(".py") else sorted((source / layer).rglob("*.py"))[-1]
    changed.write_bytes(changed.read_bytes() + b"#")
    assert code_cache.source_hash() != before


def test_another_numba_has_another_folder(monkeypatch):
    before = code_cache.source_hash()
    monkeypatch.setattr(code_cache, "version", lambda name: "0")
    assert code_cache.source_hash() != before


def test_the_report_does_not_change_the_folder(source, monkeypatch):
    before = code_cache.source_hash()
    monkeypatch.setattr(code_cache, "_PACKAGE", source)
    page = source / "report" / "page.py"
    page.write_bytes(page.read_bytes() + b"#")
    assert code_cache.source_hash() == before


CALLER = """
from abhv_mc.jit import on_first_compile
from abhv_mc.world.caller import call
on_first_compile(lambda: print("compiling"))
print(call(1.0), call(2.0))
"""


def test_a_change_in_another_file_reaches_cached_code(source, tmp_path):
    (source / "world" / "called.py").write_text(
        "from abhv_mc.jit import scalar\n@scalar\ndef add(x):\n    return x + 1.0\n"
    )
    (source / "world" / "caller.py").write_text(
        "from abhv_mc.jit import kernel\nfrom abhv_mc.world.called import add\n"
        "@kernel\ndef call(x):\n    return add(x)\n"
    )
    assert run(CALLER, source, tmp_path / "cache") == ["compiling", "2.0", "3.0"]
    assert run(CALLER, source, tmp_path / "cache") == ["2.0", "3.0"]  # from the cache, and nothing is announced
    called = source / "world" / "called.py"
    called.write_text(called.read_text().replace("1.0", "5.0"))
    assert run(CALLER, source, tmp_path / "cache") == ["compiling", "6.0", "7.0"]


def test_a_home_that_takes_no_files_is_no_obstacle(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    folder = code_cache.cache_folder()
    assert folder.is_dir() and tmp_path not in folder.parents


def test_a_changed_table_changes_the_flight_without_compiling(repository, tmp_path):
    configs = shutil.copytree(repository / "configs", tmp_path / "configs")

    def fly_level():
        files = configs / "vehicle/ghame_x.yaml", configs / "mission/level.yaml", configs / "control/tlc.yaml"
        plan = prepare(*files, "tlc")
        return fly(plan, nominal_parameters()).metrics

    before = fly_level()
    compiled = len(compiled_flight(LANES).signatures)
    table = configs / "vehicle/ghame/cd_basic.csv"
    head, *rows = table.read_text().splitlines()
    changed = [",".join([*row.split(",")[:-1], str(1.05 * float(row.split(",")[-1]))]) for row in rows]
    table.write_text("\n".join([head, *changed]) + "\n")
    after = fly_level()
    assert len(compiled_flight(LANES).signatures) == compiled == 1
    assert not np.array_equal(before, after)
    assert np.array_equal(fly_level(), after)


LAZY = """
import sys
from abhv_mc.flight import kernel
from abhv_mc.world.earth import WGS84, radii
assert "numba" not in sys.modules and radii.__doc__ and radii.py_func(WGS84, 0.5)
assert radii(WGS84, 0.5) == radii.py_func(WGS84, 0.5)
assert "numba" in sys.modules and len(radii.signatures) == 0 < len(radii.dispatcher._called.signatures)
"""


def test_decorating_does_not_load_numba(tmp_path):
    run(LAZY, PACKAGE, tmp_path)
