"""Where compiled code is kept: never stale, never where somebody else could have put it."""

import os
import pwd
import shutil
import stat
import tempfile
import threading
from pathlib import Path

import pytest

import abhv_mc
from abhv_mc import cache
from abhv_mc.user_code import trust
from abhv_mc.user_code.source import OwnSource

PACKAGE = Path(abhv_mc.__file__).parent
LAYERS = ["cache.py", "jit.py", "jit_cuda.py", "numerics", "world", "vehicle", "plant", "control", "flight"]


@pytest.fixture
def source(tmp_path):
    """A copy of the package's source."""
    skip = shutil.ignore_patterns("__pycache__", "shipped_files")
    return shutil.copytree(PACKAGE, tmp_path / "source" / "abhv_mc", ignore=skip)


@pytest.mark.parametrize("layer", LAYERS)
def test_any_change_to_what_is_compiled_changes_the_hash(source, monkeypatch, layer):
    before = cache.source_hash()
    monkeypatch.setattr(cache, "_PACKAGE", source)
    assert cache.source_hash() == before and cache.source_unchanged()  # the place does not matter
    changed = source / layer if layer.endswith(".py") else sorted((source / layer).rglob("*.py"))[-1]
    changed.write_bytes(changed.read_bytes() + b"#")
    assert cache.source_hash() != before and not cache.source_unchanged()


def test_another_numba_has_another_hash(monkeypatch):
    before = cache.source_hash()
    monkeypatch.setattr(cache, "version", lambda name: "0")
    assert cache.source_hash() != before


def test_the_report_does_not_change_the_hash(source, monkeypatch):
    before = cache.source_hash()
    monkeypatch.setattr(cache, "_PACKAGE", source)
    page = source / "report" / "pages" / "page.py"
    page.write_bytes(page.read_bytes() + b"#")
    assert cache.source_hash() == before


def test_what_changes_the_code_changes_the_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folders = [cache.cache_folder("private"), cache.cache_folder("public")]
    monkeypatch.setattr(cache, "_SOURCE", "another")
    folders.append(cache.cache_folder("private"))
    assert len(set(folders)) == 3 and all(tmp_path in folder.parents for folder in folders)


@pytest.fixture
def temporary(monkeypatch, tmp_path):
    """A system's temporary folder, and a home that takes no files."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    cache._fresh_folder.cache_clear()
    yield folder
    cache._fresh_folder.cache_clear()


def guessed(temporary):
    return temporary / f"abhv-mc-{os.getuid()}"


def mode(folder):
    return stat.S_IMODE(folder.stat().st_mode)


def test_a_home_that_takes_no_files_is_no_obstacle(temporary):
    folder = cache.cache_folder("private")
    assert folder.parent == guessed(temporary) and mode(folder.parent) == 0o700
    assert cache.cache_folder("private") == folder  # and so it is in the next process


def prepare_link(place, elsewhere):
    place.symlink_to(elsewhere)


def prepare_open_folder(place, elsewhere):
    place.mkdir()
    place.chmod(0o777)


def prepare_readable_folder(place, elsewhere):
    place.mkdir()
    place.chmod(0o755)


def prepare_file(place, elsewhere):
    place.touch()


@pytest.mark.parametrize("prepare", [prepare_link, prepare_open_folder, prepare_readable_folder, prepare_file])
def test_a_folder_that_others_may_have_filled_is_not_used(temporary, tmp_path, prepare):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    prepare(guessed(temporary), elsewhere)
    folder = cache.cache_folder("private")
    assert guessed(temporary) not in folder.parents and not any(elsewhere.iterdir())
    assert temporary in folder.parents and mode(folder.parent) == 0o700
    assert cache.cache_folder("private") == folder  # one for this process


def test_a_folder_of_another_user_is_not_used(temporary, monkeypatch):
    somebody = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: somebody)
    planted = guessed(temporary)
    planted.mkdir(mode=0o700)  # whoever this process is, it is not that user
    assert planted not in cache.cache_folder("private").parents


def test_a_user_without_a_home_is_no_obstacle(temporary, monkeypatch):
    """No HOME, and a user id that the password file does not know, as in a container."""
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)

    def nobody(uid):
        raise KeyError(uid)

    monkeypatch.setattr(pwd, "getpwuid", nobody)
    assert cache.cache_folder("private").parent == guessed(temporary)
    source = OwnSource("text", "law.py")
    trust.trust(source)
    assert not trust.is_trusted(source)


@pytest.mark.parametrize("opened", ["", "abhv-mc", "abhv-mc/name"])
def test_a_home_that_others_may_write_to_keeps_no_code(temporary, monkeypatch, tmp_path, opened):
    """HOME=/tmp, say: what lies in .cache there may be anybody's."""
    home = tmp_path / "home"
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    folder = cache.cache_folder("private")
    assert home in folder.parents
    (home / opened.replace("name", folder.name)).chmod(0o777)
    assert home not in cache.cache_folder("private").parents


def test_a_lock_follows_no_link(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("kept")
    (tmp_path / "lock").symlink_to(victim)
    (tmp_path / "other.lock").symlink_to(tmp_path / "new")
    with cache.one_at_a_time(tmp_path / "lock"), cache.one_at_a_time(tmp_path / "other.lock"):
        pass
    assert victim.read_text() == "kept" and not (tmp_path / "new").exists()


def enter_beside(enter):
    """What a second thread and then this one, which came first, have said."""
    said = []

    def second():
        with enter():
            said.append("second")

    with enter():
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.2)
        said.append("first")
    thread.join()
    return said


def test_one_process_at_a_time(tmp_path):
    assert enter_beside(lambda: cache.one_at_a_time(tmp_path / "lock")) == ["first", "second"]


def test_only_who_has_to_compile_waits(tmp_path):
    def enter():
        return cache.one_compiles(str(tmp_path), "fly")

    (tmp_path / "lanes.fly_on-7.py311.nbi").touch()  # another kernel
    assert enter_beside(enter) == ["first", "second"]
    kept = tmp_path / "lanes.fly-7.py311.nbi"
    with enter():
        kept.write_text("machine code")
    assert enter_beside(enter) == ["second", "first"] and kept.exists()
    kept.write_text("nachine code")
    other = tmp_path / "lanes._fly-7.py311.nbi"  # a kernel whose name ends as this one's
    other.write_text("machine code")
    assert enter_beside(enter) == ["first", "second"] and not kept.exists() and other.exists()
