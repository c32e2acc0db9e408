"""Tests of compiled functions.

They agree with plain Python, are never stale in the cache, and report compilation.
"""

import contextlib
import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest
from programs import run_python

import abhv_mc_vehicle
from abhv_mc_vehicle.flight.fly import compiled_flight, fly, nominal_parameters
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.kernel import jit
from abhv_mc_vehicle.kernel.flight.interface import LANES
from abhv_mc_vehicle.kernel.jit import kernel, lanes, routine, scalar

PACKAGE = Path(abhv_mc_vehicle.__file__).parent


@pytest.fixture
def source(source):
    """Return a copy of the vehicle's source, beside a copy of the core."""
    return source.with_name("abhv_mc_vehicle")


def run(code, source, cache, environment=os.environ):
    environment = {**environment, "PYTHONPATH": str(source.parent), "XDG_CACHE_HOME": str(cache)}
    return run_python("-u", "-c", code, env=environment, check=True).stdout.split()


ADD_ONE = (
    "from abhv_mc_vehicle.kernel.jit import kernel\n@kernel\ndef call(x):\n    return x + 1.0\n"
)
CALLER = """
import contextlib
from abhv_mc_vehicle.kernel.jit import set_compile_listener
from abhv_mc_vehicle.kernel.world.caller import call
set_compile_listener(lambda function, elsewhere: contextlib.nullcontext(print("compiling")))
print(call(1.0), call(2.0))
"""


@pytest.mark.skipif(jit.compiler() == "public", reason="numba's own cache")
def test_a_copy_of_the_source_elsewhere_loads_compiled_kernels(source, tmp_path):
    (source / "kernel" / "world" / "caller.py").write_text(ADD_ONE)
    assert run(CALLER, source, tmp_path / "cache") == ["compiling", "2.0", "3.0"]
    clone = shutil.copytree(source.parent, tmp_path / "clone", copy_function=shutil.copy)
    other = clone / source.name
    assert run(CALLER, other, tmp_path / "cache") == ["2.0", "3.0"]


@pytest.mark.thorough
@pytest.mark.skipif(jit.compiler() == "public", reason="numba's own cache")
def test_a_flipped_bit_in_the_cache_is_not_executed(source, tmp_path):
    """Regression test: a damaged file gave wrong numbers, a crash or a traceback at each start."""
    (source / "kernel" / "world" / "caller.py").write_text(ADD_ONE)
    assert run(CALLER, source, tmp_path / "cache") == ["compiling", "2.0", "3.0"]
    for suffix, position in (("nbi", 0), ("nbc", 0.7), ("sha256", -1)):
        (file,) = (tmp_path / "cache").rglob(f"*call*.{suffix}")
        content = bytearray(file.read_bytes())
        content[position if position in (0, -1) else int(position * len(content))] ^= 0x10
        file.write_bytes(content)
        assert run(CALLER, source, tmp_path / "cache") == ["compiling", "2.0", "3.0"], suffix
    other = CALLER.replace(
        "call(1.0), call(2.0)", "call(1.0), call(1)"
    )  # a kernel for other arguments joins the first
    assert run(other, source, tmp_path / "cache") == ["compiling", "2.0", "2.0"]
    assert run(other, source, tmp_path / "cache") == ["2.0", "2.0"]
    assert run(CALLER, source, tmp_path / "cache") == ["2.0", "3.0"]


EDITED = """
import pathlib
import abhv_mc_vehicle.kernel.world
from abhv_mc_vehicle.kernel.world.caller import call
file = pathlib.Path(abhv_mc_vehicle.kernel.world.__file__)
file.write_bytes(file.read_bytes() + b"#")
print(call(1.0))
"""


@pytest.mark.thorough
def test_code_of_a_source_edited_meanwhile_is_not_cached(source, tmp_path):
    (source / "kernel" / "world" / "caller.py").write_text(ADD_ONE)
    assert run(EDITED, source, tmp_path / "cache") == ["2.0"]
    assert not list((tmp_path / "cache").rglob("caller*.nbi"))


def test_a_changed_table_changes_the_flight_without_compiling(repository, tmp_path):
    configs = shutil.copytree(repository / "configs", tmp_path / "configs")
    files = (
        configs / "vehicle/ghame_x.yaml",
        configs / "mission/level.yaml",
        configs / "control/tlc.yaml",
    )

    def fly_level():
        return fly(prepare(*files, "tlc"), nominal_parameters()).metrics

    before = fly_level()
    compiled = len(compiled_flight(LANES).signatures)
    table = configs / "vehicle/ghame/cd_basic.csv"
    frame = pd.read_csv(table)
    frame.assign(value=1.05 * frame["value"]).to_csv(table, index=False)
    after = fly_level()
    assert len(compiled_flight(LANES).signatures) == compiled == 1
    assert not np.array_equal(before, after)
    assert np.array_equal(fly_level(), after)


@scalar
def cube(x):
    return x * x * x


@lanes
def cubes(Z, width):
    for lane in range(width):
        Z[1, lane] = cube(Z[0, lane]) / (1.0 - Z[0, lane])


@routine
def total(row):
    sum_ = 0.0
    for x in row:
        sum_ += x
    return sum_


@kernel
def fly_cubes(Z, width):
    cubes(Z, width)
    return total(Z[1, :width])


def numbers():
    return np.random.default_rng(1).normal(size=(2, 16))


@pytest.mark.parametrize("width", [1, 7, 16])
def test_compiled_code_agrees_with_python(width):
    """Results agree bit for bit through nested calls, for any number of lanes."""
    compiled, plain = numbers(), numbers()
    for lane in range(width):
        plain[1, lane] = plain[0, lane] * plain[0, lane] * plain[0, lane] / (1.0 - plain[0, lane])
    assert fly_cubes(compiled, width) == sum(plain[1, :width].tolist())
    np.testing.assert_array_equal(compiled, plain)


def test_numba_functions_may_call_inlined_ones():
    """Functions called at any depth are linked."""

    @scalar
    def power_nine(x):
        return cube(cube(x))

    @numba.njit
    def user(x):
        return power_nine(x) + cube(x)

    assert user(2.0) == 520.0


@lanes
def first(Z, width, is_needed):
    if is_needed:
        cubes(Z, width)
    Z[1, 0] = 1.0


@lanes
def second(Z, width):
    cubes(Z, width)


@kernel
def both(Z, width):
    first(Z, width, False)
    second(Z, width)


def test_functions_that_only_a_later_call_needs_are_linked():
    """Link a function without a caller.

    The first caller's branch is dead for this argument, so ``cube`` has no caller.
    """
    linked, expected = numbers(), numbers()
    both(linked, 16)
    fly_cubes(expected, 16)
    np.testing.assert_array_equal(linked, expected)


@pytest.mark.skipif(jit.compiler() == "public", reason="numba's own dispatcher")
def test_a_full_disk_is_no_fault(monkeypatch):
    @kernel
    def halve(x):
        return (x - x) + x / 2.0

    def full(*_):
        raise OSError(errno.ENOSPC, "no space left")

    for name in ("load_overload", "save_overload", "flush"):
        monkeypatch.setattr(
            halve._cache, name, full if name != "load_overload" else lambda *_: None
        )
    assert halve(3.0) == 1.5


@pytest.mark.skipif(jit.compiler() == "public", reason="numba's own dispatcher")
def test_an_interrupt_during_compilation_is_raised(monkeypatch):
    """Regression test: LLVM's callback lost it, and numba failed with another error."""

    @kernel
    def third(x):
        return x / 3.0

    def lose(self):
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr(numba.core.codegen.CPUCodeLibrary, "_finalize_final_module", lose)
    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # processes in the background ignore it
    try:
        with pytest.raises(KeyboardInterrupt):
            third(1.0)
    finally:
        signal.signal(signal.SIGINT, before)


BROKEN = """
import warnings
import numba.core.codegen
{change}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from abhv_mc_vehicle.kernel import jit
    from abhv_mc_vehicle.kernel.world.earth import WGS84, radii
    print(jit.compiler(), len(caught), radii(WGS84, 0.5) == radii.py_func(WGS84, 0.5))
import subprocess, sys
code = "from abhv_mc_vehicle.kernel import jit; print(jit.compiler())"
subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
"""


@pytest.mark.thorough
@pytest.mark.parametrize(
    "change",
    [
        "",  # unchanged
        "del numba.core.codegen.JITCodeLibrary",  # does not import
        "numba.core.codegen.JITCodeLibrary = type('Another', (), dict())",  # does not compile
    ],
)
def test_the_public_interface_compiles_if_the_private_one_has_changed(tmp_path, change):
    """There is one warning, and none in child processes."""
    environment = dict(os.environ)
    environment.pop("ABHV_MC_PUBLIC_NUMBA", None)
    expected = ["public", "1", "True", "public"] if change else ["private", "0", "True", "private"]
    assert run(BROKEN.format(change=change), PACKAGE, tmp_path, environment)[:4] == expected


def test_numba_is_imported_when_something_compiles():
    """Reports and custom simulators compile nothing; the import would be a fifth of their start."""
    code = (
        "import sys\n"
        "import abhv_mc.execution.table_import, abhv_mc.execution.runner, "
        "abhv_mc.report.pages.build\n"
        "assert not {'numba', 'llvmlite', 'scipy.linalg'} & set(sys.modules)\n"
        "from abhv_mc_vehicle.kernel.numerics.lane_math import exp\n"
        "assert exp(0.0) == 1.0 and 'numba' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
