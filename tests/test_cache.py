"""Where compiled code is kept: never stale, and compiled once."""

import shutil
import threading
from pathlib import Path

import pytest

import abhv_mc
from abhv_mc import cache

PACKAGE = Path(abhv_mc.__file__).parent
LAYERS = ["cache.py", "jit.py", "jit_cuda.py", "numerics", "world", "vehicle", "plant", "control", "flight"]


@pytest.fixture
def source(tmp_path):
    """A copy of the package's source."""
    skip = shutil.ignore_patterns("__pycache__", "shipped_files")
    return shutil.copytree(PACKAGE, tmp_path / "source" / "abhv_mc", ignore=skip)


def test_any_change_to_what_is_compiled_changes_the_hash(source, monkeypatch):
    before = cache.source_hash()
    monkeypatch.setattr(cache, "_PACKAGE", source)
    assert cache.source_hash() == before and cache.source_unchanged()  # the place does not matter
    for layer in LAYERS:
        changed = source / layer if layer.endswith(".py") else sorted((source / layer).rglob("*.py"))[-1]
        changed.write_bytes(changed.read_bytes() + b"#")
        assert cache.source_hash() != before and not cache.source_unchanged(), layer
        before = cache.source_hash()


def test_another_numba_has_another_hash(monkeypatch):
    before = cache.source_hash()
    monkeypatch.setattr(cache, "version", lambda name: "0")
    assert cache.source_hash() != before


def test_what_changes_the_code_changes_the_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folders = [cache.cache_folder("private"), cache.cache_folder("public")]
    monkeypatch.setattr(cache, "_SOURCE", "another")
    folders.append(cache.cache_folder("private"))
    assert len(set(folders)) == 3 and all(tmp_path in folder.parents for folder in folders)


def enter_beside(enter):
    """What a second thread and then this one, which came first, have said."""
    said = []

    def second():
        with enter():
            said.append("second")

    with enter():
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.05)
        said.append("first")
    thread.join()
    return said


def test_only_who_has_to_compile_waits(tmp_path):
    def enter():
        return cache.one_compiles(str(tmp_path), "fly")

    (tmp_path / "lanes.fly_on-7.py311.nbi").touch()  # other kernels
    (tmp_path / "lanes._fly-7.py311.nbi").touch()
    assert enter_beside(enter) == ["first", "second"]
    kept = tmp_path / "lanes.fly-7.py311.nbi"
    with enter():
        kept.write_text("machine code")
    assert enter_beside(enter) == ["second", "first"] and kept.exists()
    kept.write_text("nachine code")
    assert enter_beside(enter) == ["first", "second"] and not kept.exists()
    assert (tmp_path / "lanes._fly-7.py311.nbi").exists()
