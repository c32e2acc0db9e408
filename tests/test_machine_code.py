"""Kept machine code does what the function says, and is never called with what it was not made for."""

import os
import subprocess
import sys
import threading
from typing import NamedTuple

import numba
import numpy as np
import pytest

from abhv_mc import jit, machine_code
from abhv_mc.code_cache import one_at_a_time
from abhv_mc.jit import standalone


class Inner(NamedTuple):
    singles: np.ndarray
    words: np.ndarray
    factor: float


class Outer(NamedTuple):
    inner: Inner
    offset: int
    twice: bool


@standalone
def fill(outer, pair, grid, out):
    inner = outer.inner
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            for k in range(grid.shape[2]):
                out[i] += grid[i, j, k] * (j + 1) * (10 * k + 1)
        out[i] = out[i] * inner.factor + outer.offset + pair[0] * pair[1]
        out[i] += inner.singles[i] + inner.words[0, i]
        if outer.twice:
            out[i] *= 2.0


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Where code is kept; each test begins with none."""
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(fill, "_loaded", {})
    return tmp_path / "kernels"


@pytest.fixture
def made(monkeypatch):
    """What has been compiled rather than recalled."""
    compiler, names = jit.load_compiler(), []
    make = compiler.make_machine_code

    def watch(function, arguments):
        names.append(function.__name__)
        return make(function, arguments)

    monkeypatch.setattr(compiler, "make_machine_code", watch)
    return names


def arguments(twice=True, rows=3):
    generator = np.random.default_rng(2)
    singles = np.array([1.5, 2.5, 3.5], np.float32)
    words = np.array([[2**31 + 1, 5, 7]], np.uint32)
    words.flags.writeable = False
    outer = Outer(Inner(singles, words, 0.25), -3, twice)
    return outer, (np.float64(2.0), np.int64(4)), generator.normal(size=(rows, 2, 4)), np.zeros(rows)


@pytest.mark.parametrize("twice", [True, False])
@pytest.mark.parametrize("rows", [3, 0])
def test_arguments_of_every_kind_arrive(twice, rows):
    compiled, plain = arguments(twice, rows), arguments(twice, rows)
    fill(*compiled)
    fill.py_func(*plain)
    np.testing.assert_array_equal(compiled[-1], plain[-1])


def call_anew(monkeypatch):
    monkeypatch.setattr(fill, "_loaded", {})
    result = arguments()
    fill(*result)
    return result[-1].tolist()


def kept_file(folder):
    (file,) = (path for path in folder.iterdir() if path.suffix != ".lock")
    return file


def test_kept_code_is_recalled(folder, made, monkeypatch):
    first = call_anew(monkeypatch)
    assert kept_file(folder).exists()
    assert call_anew(monkeypatch) == first and made == ["fill"]


def flip(data):
    data = bytearray(data)
    data[-len(data) // 4] ^= 1
    return bytes(data)


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[:-1], lambda data: b"\n" + data, flip])
def test_damaged_code_is_made_anew(folder, made, monkeypatch, damage):
    first = call_anew(monkeypatch)
    whole = kept_file(folder).read_bytes()
    kept_file(folder).write_bytes(damage(whole))
    assert call_anew(monkeypatch) == first
    assert made == ["fill"] * 2 and kept_file(folder).stat().st_size == len(whole)


def test_whole_code_for_something_else_is_not_recalled(folder, monkeypatch):
    call_anew(monkeypatch)
    file = kept_file(folder)
    made_for = file.read_bytes().split(b"\n")[1].decode()
    assert machine_code.recall_code(file, made_for) is not None
    assert machine_code.recall_code(file, made_for.replace("float64", "float32").replace("<f8", "<f4")) is None


def test_code_that_this_process_cannot_link_is_not_recalled(tmp_path):
    file = tmp_path / "code"
    machine_code.keep_code(file, "this", machine_code.MachineCode("f", ("no_such_function",), b""))
    assert machine_code.recall_code(file, "this") is None
    machine_code.keep_code(file, "this", machine_code.MachineCode("f", ("sqrt", "memset"), b"\n\n"))
    assert machine_code.recall_code(file, "this") == machine_code.MachineCode("f", ("sqrt", "memset"), b"\n\n")


def test_code_of_a_source_edited_meanwhile_is_not_kept(folder, made, monkeypatch):
    monkeypatch.setattr(jit, "source_unchanged", lambda: False)
    assert call_anew(monkeypatch) == call_anew(monkeypatch)
    monkeypatch.setattr(jit, "source_unchanged", lambda: True)
    monkeypatch.setattr(jit, "file_hash", lambda _: "edited")
    call_anew(monkeypatch)
    call_anew(monkeypatch)
    assert made == ["fill"] * 4


def test_another_processor_has_its_own_code(made, monkeypatch):
    call_anew(monkeypatch)
    monkeypatch.setattr(jit, "describe_processor", lambda: "another")
    call_anew(monkeypatch)
    assert made == ["fill"] * 2


@pytest.mark.parametrize("setting", ["NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_ENABLE_AVX"])
def test_numbas_settings_make_another_processor(monkeypatch, setting):
    describe = machine_code.describe_processor.__wrapped__
    before = describe()
    monkeypatch.setenv(setting, "0")
    assert describe() != before


class Swapped(NamedTuple):  # as Inner, in another order
    words: np.ndarray
    singles: np.ndarray
    factor: float


def test_types_tell_arguments_apart():
    outer, pair, grid, out = arguments()
    inner = outer.inner
    several = [
        (outer, pair, grid, out),
        (outer, pair, grid[0], out),
        (outer, pair, grid.astype(np.float32), out),
        (outer, (2.0, 4.0), grid, out),
        (outer, (2.0, True), grid, out),
        (outer, (2.0, 4, 4), grid, out),
        (outer._replace(inner=Swapped(inner.singles, inner.words, 0.25)), pair, grid, out),
        (outer._replace(inner=inner._replace(words=inner.words.copy())), pair, grid, out),
        (outer, *pair, grid, out),
    ]
    kinds = [machine_code.flatten(each)[0] for each in several]
    assert len(set(kinds)) == len(set(map(machine_code.describe, kinds))) == len(several)


@pytest.mark.parametrize(
    "value", [None, "text", 2**63, np.zeros((4, 4))[:, :2], np.zeros((2, 3)).T, np.zeros(2, ">f8"), np.zeros(2, "U4")]
)
def test_what_no_kernel_takes_is_said(value):
    with pytest.raises(TypeError, match=type(value).__name__):
        fill(value)


def test_what_is_not_standalone_is_said():
    @standalone
    def returns(x):
        return x[0]

    @standalone
    def prints(x):
        print(x[0])  # through Python

    for wrong in (returns, prints):
        with pytest.raises(TypeError, match=wrong.py_func.__name__):
            wrong(np.zeros(2))

    @standalone
    def allocates(x):
        x[0] = np.ones(x.size).sum()

    with pytest.raises(numba.TypingError):
        allocates(np.zeros(2))


def test_constants_are_numbers_and_tell_kernels_apart(made):
    def make(constant):
        @standalone
        def put(x):
            x[0] = constant

        return put

    x = np.zeros(1)
    for constant in (1.0, 2.0, 1.0):
        make(constant)(x)
        assert x[0] == constant
    assert made == ["put"] * 2
    with pytest.raises(TypeError, match="numbers"):
        make(np.zeros(1))(x)


def test_a_fault_inside_is_raised():
    @standalone
    def refuse(x):
        if x[0] < 0.0:
            raise ValueError
        x[0] = 1.0

    x = np.zeros(1)
    refuse(x)
    assert x[0] == 1.0
    with pytest.raises(RuntimeError, match="refuse"):
        refuse(-x)


def test_a_disk_that_takes_nothing_is_no_fault(folder, monkeypatch):
    folder.write_text("a file where the folder would be")
    assert call_anew(monkeypatch) == call_anew(monkeypatch)


def test_threads_compile_once(made):
    results = [arguments() for _ in range(4)]
    threads = [threading.Thread(target=fill, args=result) for result in results]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == ["fill"] and len({tuple(result[-1]) for result in results}) == 1


def test_one_process_at_a_time(tmp_path):
    inside = []

    def enter():
        with one_at_a_time(tmp_path / "lock"):
            inside.append("second")

    with one_at_a_time(tmp_path / "lock"):
        second = threading.Thread(target=enter)
        second.start()
        second.join(0.2)
        inside.append("first")
    second.join()
    assert inside == ["first", "second"]


STARTS = """
import sys
from abhv_mc.cli.app import main
sys.argv = ["abhv-mc", "fly", "level", "--controller", "lqr"]
try:
    main()
finally:
    print({"numba", "scipy.linalg"} & set(sys.modules))
"""


def test_a_flight_from_the_cache_needs_no_numba():
    for _ in range(2):  # the first may compile
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        done = subprocess.run(
            [sys.executable, "-c", STARTS], env=environment, capture_output=True, text=True, check=True
        )
    assert done.stdout.splitlines()[-1] == "set()"
    assert "compiling" not in done.stderr
