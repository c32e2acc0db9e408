"""Where compiled code is kept: never stale, and compiled once."""

import contextlib
import threading

from abhv_mc.kernel import cache

WORDS = ("flight/metrics.py", "flight/channels.py", "flight/outcome.py", "plant/parameters.py", "user_code/compiled.py")


def test_any_change_to_what_is_compiled_changes_the_hash_and_no_other(source, monkeypatch):
    before = cache.source_hash()
    monkeypatch.setattr(cache, "_PACKAGE", source / "kernel")
    for name in WORDS:  # labels, messages, units, docs
        (source / name).write_bytes((source / name).read_bytes() + b"#")
    assert cache.source_hash() == before and cache.source_unchanged()  # the place does not matter either
    for changed in sorted((source / "kernel").rglob("*.py")):
        changed.write_bytes(changed.read_bytes() + b"#")
        assert cache.source_hash() != before and not cache.source_unchanged(), changed
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


def enter_beside(enter, waits):
    """What a second thread and then this one, which came first, have said; ``waits``: the second is to."""
    said = []

    def second():
        with enter():
            said.append("second")

    with enter():
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.05 if waits else 60.0)
        said.append("first")
    thread.join()
    return said


def test_only_who_has_to_compile_waits(tmp_path):
    def enter():
        return cache.one_compiles(str(tmp_path), "fly")

    (tmp_path / "lanes.fly_on-7.py311.nbi").touch()  # other kernels
    (tmp_path / "lanes._fly-7.py311.nbi").touch()
    assert enter_beside(enter, waits=True) == ["first", "second"]
    kept = tmp_path / "lanes.fly-7.py311.nbi"
    with enter():
        kept.write_text("machine code")
    assert enter_beside(enter, waits=False) == ["second", "first"] and kept.exists()
    kept.write_text("nachine code")
    assert enter_beside(enter, waits=True) == ["first", "second"] and not kept.exists()
    assert (tmp_path / "lanes._fly-7.py311.nbi").exists()


def test_waiting_for_another_process_is_said(tmp_path):
    said, inside = [], threading.Event()

    @contextlib.contextmanager
    def waiting():
        said.append("waits")
        inside.set()
        yield
        said.append("goes on")

    def second():
        with cache.one_compiles(tmp_path, "fly", waiting):
            said.append("compiles")

    with cache.one_compiles(tmp_path, "fly", waiting):
        thread = threading.Thread(target=second)
        thread.start()
        assert inside.wait(60.0)
        said.append("done")
    thread.join()
    assert said == ["waits", "done", "goes on", "compiles"]
