"""Tests of the cache of compiled code.

It is never stale, compiles once and uses the full width of a processor's vectors.
"""

import contextlib
import errno
import fcntl
import os
import pwd
import tempfile
import threading
from pathlib import Path

import llvmlite.binding as llvm
import numba
import pytest
from programs import run_python

from abhv_mc import cache_root
from abhv_mc_vehicle.kernel import cache, jit
from abhv_mc_vehicle.kernel.compiler_target import code_folder, find_features

DESCRIPTIONS = (
    "flight/metrics.py",
    "flight/channels.py",
    "flight/plan.py",
    "plant/parameters.py",
    "user_code/compiled.py",
)


def test_only_changes_of_compiled_source_change_the_hash(source, monkeypatch):
    before = cache.source_hash()
    vehicle, numbers = source.with_name("abhv_mc_vehicle"), source / "flights"
    monkeypatch.setattr(cache, "_PACKAGE", vehicle / "kernel")
    monkeypatch.setattr(cache, "_NUMBERS", [numbers / "statistic.py", numbers / "timing.py"])
    for name in DESCRIPTIONS:  # labels, messages, units, docs
        (vehicle / name).write_bytes((vehicle / name).read_bytes() + b"#")
    assert (
        cache.source_hash() == before and cache.source_unchanged()
    )  # nor does the location matter
    for changed in [*sorted((vehicle / "kernel").rglob("*.py")), *cache._NUMBERS]:
        changed.write_bytes(changed.read_bytes() + b"#")
        assert cache.source_hash() != before and not cache.source_unchanged(), changed
        before = cache.source_hash()


SETTINGS = {
    "BOUNDSCHECK": 1,
    "DEBUGINFO_DEFAULT": 1,
    "DISABLE_INTEL_SVML": 1,
    "LOOP_VECTORIZE": 0,
    "SLP_VECTORIZE": 1,
}


def test_settings_that_change_the_code_change_its_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folders = {code_folder("private"), code_folder("public")}
    for name, value in SETTINGS.items():
        assert getattr(numba.config, name) != value
        with monkeypatch.context() as patch:
            patch.setattr(numba.config, name, value)
            folders.add(code_folder("private"))
    with monkeypatch.context() as patch:
        patch.setattr(cache, "_SOURCE", "another")
        folders.add(code_folder("private"))
    assert len(folders) == 3 + len(SETTINGS) and all(
        tmp_path in folder.parents for folder in folders
    )
    assert code_folder("private") in folders
    before = cache.source_hash()
    monkeypatch.setattr(cache, "version", lambda name: "0")  # another numba
    assert cache.source_hash() != before


def enter_beside(folder):
    """Return the order of events of two threads.

    The first continues if the second is inside or waits.
    """
    events, entered = [], threading.Event()

    @contextlib.contextmanager
    def waiting():
        events.append("waits")
        entered.set()
        yield

    def second():
        with cache.compilation_lock(folder, "fly", waiting):
            events.append("second")
            entered.set()

    with cache.compilation_lock(folder, "fly", waiting):
        thread = threading.Thread(target=second)
        thread.start()
        assert entered.wait(60.0)
        events.append("first")
    thread.join()
    return events


def test_only_a_process_that_has_to_compile_waits(tmp_path):
    (tmp_path / "lanes.fly_on-7.py311.nbi").touch()  # other kernels
    (tmp_path / "lanes._fly-7.py311.nbi").touch()
    assert enter_beside(tmp_path) == ["waits", "first", "second"]
    compiled = tmp_path / "lanes.fly-7.py311.nbi"
    with cache.compilation_lock(str(tmp_path), "fly"):
        compiled.write_text("machine code")
    assert enter_beside(tmp_path) == ["second", "first"] and compiled.exists()
    compiled.write_text("nachine code")
    assert enter_beside(tmp_path) == ["waits", "first", "second"] and not compiled.exists()
    assert (tmp_path / "lanes._fly-7.py311.nbi").exists()


NO_FOLDER = "/dev/null/none"  # cannot be created


@pytest.fixture
def bare(monkeypatch, tmp_path):
    """Set up the environment of a container; return its temporary folder.

    Its user is unknown and has no home.
    """

    def refuse(_):
        raise KeyError

    for name in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    for name in ("XDG_CACHE_HOME", "MPLCONFIGDIR"):  # that the fallback sets
        monkeypatch.setenv(name, NO_FOLDER)
    monkeypatch.setattr(pwd, "getpwuid", refuse)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cache_root._find_root.cache_clear()
    return tmp_path / f"abhv-mc-{os.getuid()}"


@pytest.mark.parametrize("name", ["XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "HOME"])
def test_the_cache_is_in_the_first_writable_folder(monkeypatch, tmp_path, bare, name):
    names = ["XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "HOME"]
    for other in names[: names.index(name)]:
        monkeypatch.setenv(other, NO_FOLDER)
    for other in names[names.index(name) :]:
        monkeypatch.setenv(other, str(tmp_path / other))
    expected = tmp_path / name / ("" if name != "HOME" else ".cache") / "abhv-mc"
    assert cache_root.cache_root() == expected and expected.is_dir()


@pytest.mark.parametrize("home", [None, NO_FOLDER])
def test_without_a_home_the_cache_is_a_private_temporary_folder(monkeypatch, bare, home):
    if home:
        monkeypatch.setenv("HOME", home)
    with pytest.warns(RuntimeWarning, match="Set XDG_CACHE_HOME") as warned:
        root = cache_root.cache_root()
    assert root.parent == bare and bare.stat().st_mode & 0o777 == 0o700
    assert cache_root.cache_root() == root and len(warned) == 1  # in child processes, too
    assert Path(os.environ["XDG_CACHE_HOME"]) == bare


@pytest.mark.parametrize("kind", ["link", "open", "file"])
def test_a_temporary_folder_of_another_user_is_not_used(monkeypatch, bare, kind):
    if kind == "link":
        (bare.parent / "elsewhere").mkdir(mode=0o700)
        bare.symlink_to("elsewhere")
    elif kind == "open":
        bare.mkdir()
        bare.chmod(0o755)
    else:
        bare.touch()
    ends = []
    monkeypatch.setattr(
        cache_root.atexit, "register", lambda *call, **options: ends.append((call, options))
    )
    with pytest.warns(RuntimeWarning, match="XDG_CACHE_HOME") as warned:
        root = cache_root.cache_root()
    assert str(root.parent) in str(warned[0].message)
    assert root.parent.parent == bare.parent and root.parent != bare
    for (function, *arguments), options in ends:
        function(*arguments, **options)
    assert not root.parent.exists()


@pytest.mark.parametrize("name", ["XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "HOME/.cache"])
@pytest.mark.parametrize(
    ("owner", "mode", "is_used"),
    [
        (0, 0o755, True),
        (1, 0o2770, True),
        (1, 0o777, False),
        (2, 0o700, False),
    ],
)
@pytest.mark.skipif(os.getuid() != 0, reason="only root can give folders to other users")
def test_a_folder_that_others_can_fill_is_not_used(
    monkeypatch, tmp_path, bare, name, owner, mode, is_used
):
    """The user has the number 1."""
    folder = tmp_path / name / "abhv-mc"
    folder.mkdir(parents=True)
    folder.chmod(mode)
    os.chown(folder, owner, -1)
    variable = name.partition("/")[0]
    monkeypatch.setenv(variable, str(tmp_path / variable))
    monkeypatch.setattr(os, "getuid", lambda: 1)
    with contextlib.nullcontext() if is_used else pytest.warns(RuntimeWarning, match=str(folder)):
        assert (cache_root.cache_root() == folder) == is_used


def test_a_group_shares_what_its_members_can_write(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "abhv-mc").mkdir()
    (tmp_path / "abhv-mc").chmod(0o2770)
    folder = cache.cache_folder("x")
    assert cache.cache_folder("x") == folder
    monkeypatch.setattr(os, "access", lambda path, _: path != folder)
    assert cache.cache_folder("x") == folder.with_name(f"{folder.name}-{os.getuid()}")


def test_a_file_system_without_locks_keeps_compiled_code(monkeypatch, tmp_path):
    def refuse(*_):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with cache.compilation_lock(tmp_path, "fly"):
        (tmp_path / "lanes.fly-7.py311.nbi").write_text("machine code")
    assert cache.is_noted(tmp_path, "fly")


TWO_KERNELS = """
import fcntl
def refuse(*_):
    raise OSError(38, "Function not implemented")
fcntl.flock = refuse
from abhv_mc_vehicle.kernel.jit import compiler, kernel
def double(x):
    return x + x
first, second = kernel(double), kernel(double)
file = second._cache._cache_file
first(1.5)
load, file._load_index = file._load_index, dict
second(1)  # as a process that read the index before the first wrote it
file._load_index = load
from pathlib import Path
print(compiler(), len(list(Path(first.stats.cache_path).glob("*double*.nbc"))))
print(kernel(double)(1), kernel(double)(1.5))
"""


@pytest.mark.skipif(jit.compiler() == "public", reason="numba's own cache")
def test_two_processes_without_locks_do_not_mix_two_kernels(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    (tmp_path / "double.py").write_text(TWO_KERNELS)
    done = run_python("-W", "error", tmp_path / "double.py", env=environment)
    assert done.stdout.split() == ["private", "2", "2", "3.0"], done.stderr


class Features(dict):
    def flatten(self):
        return ",".join(f"{'+' if has else '-'}{name}" for name, has in self.items())


@pytest.mark.parametrize(
    ("features", "chosen", "expected"),
    [
        ({"avx2": True, "avx512f": True}, None, "+avx2,+avx512f,-prefer-256-bit"),
        ({"avx2": True, "avx512f": False}, None, None),  # left to numba
        ({"neon": True}, None, None),
        ({"avx512f": True}, "CPU_NAME", None),  # a user's choice stands
        ({"avx512f": True}, "CPU_FEATURES", None),
    ],
)
def test_a_processor_with_512_bit_vectors_uses_them(monkeypatch, features, chosen, expected):
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: Features(features))
    for name in ("CPU_NAME", "CPU_FEATURES"):
        monkeypatch.setattr(numba.config, name, "haswell" if name == chosen else None)
    assert find_features() == expected
