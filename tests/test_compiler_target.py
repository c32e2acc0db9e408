"""Compiled code uses the whole width of a processor's vectors, unless somebody has chosen otherwise."""

import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import numba
import numpy as np
import pytest

import abhv_mc
from abhv_mc import compiler_target, jit
from abhv_mc.compiler_target import code_folder, find_features


class Features(dict):
    def flatten(self):
        return ",".join(f"{'+' if has else '-'}{name}" for name, has in self.items())


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    for name in ("CPU_NAME", "CPU_FEATURES"):
        monkeypatch.setattr(numba.config, name, None)


def pretend(monkeypatch, features):
    monkeypatch.setattr(compiler_target.llvm, "get_host_cpu_features", lambda: Features(features))


def test_a_processor_with_512_bit_vectors_uses_them(monkeypatch):
    pretend(monkeypatch, {"avx2": True, "avx512f": True})
    assert find_features() == "+avx2,+avx512f,-prefer-256-bit"


@pytest.mark.parametrize("features", [{"avx2": True, "avx512f": False}, {"neon": True}])
def test_others_are_left_to_numba(monkeypatch, features):
    pretend(monkeypatch, features)
    assert find_features() is None


@pytest.mark.parametrize("name", ["CPU_NAME", "CPU_FEATURES"])
def test_a_user_s_choice_stands(monkeypatch, name):
    pretend(monkeypatch, {"avx512f": True})
    monkeypatch.setattr(numba.config, name, "haswell")
    assert find_features() is None


def test_a_processor_that_llvm_does_not_know(monkeypatch):
    def refuse():
        raise RuntimeError("failed to get host cpu features")

    monkeypatch.setattr(compiler_target.llvm, "get_host_cpu_features", refuse)
    assert find_features() is None


@pytest.mark.skipif(not llvm.get_host_cpu_features().get("avx512f"), reason="no 512-bit vectors here")
def test_machine_code_has_them():
    @numba.njit  # not a kernel: of what comes from the cache, numba has no assembly code
    def add(a, b):
        for i in range(a.size):
            a[i] += b[i]

    assert jit.compiler()  # which has chosen the target
    add(np.zeros(64), np.ones(64))
    (code,) = add.inspect_asm().values()
    assert "%zmm" in code


SETTINGS = {"BOUNDSCHECK": 1, "DEBUGINFO_DEFAULT": 1, "DISABLE_INTEL_SVML": 1, "LOOP_VECTORIZE": 0, "SLP_VECTORIZE": 1}


def test_settings_that_change_the_code_change_its_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folders = {code_folder("private"), code_folder("public")}
    for name, value in SETTINGS.items():
        assert getattr(numba.config, name) != value
        with monkeypatch.context() as patch:
            patch.setattr(numba.config, name, value)
            folders.add(code_folder("private"))
    assert len(folders) == 2 + len(SETTINGS)
    assert code_folder("private") in folders


TAKEN = """
import numba
from abhv_mc import jit
from abhv_mc.world.earth import radii
print(numba.config.CACHE_DIR, jit.PLAIN, numba.config.CPU_FEATURES)
if not jit.PLAIN:
    print(getattr(radii, "kernel", radii).stats.cache_path)
"""


def test_settings_are_what_numba_has_taken_from_wherever(tmp_path, monkeypatch):
    """It reads a file in the working folder, too: code without vectors was kept under the name of the usual code."""
    pytest.importorskip("yaml")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(Path(abhv_mc.__file__).parents[1])}

    def run(**more):
        command = [sys.executable, "-c", TAKEN]
        done = subprocess.run(command, env=environment | more, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    usual, file = run(), tmp_path / ".numba_config.yaml"
    file.write_text("loop_vectorize: 0\ncpu_features: +avx2\ncache_locator_classes: InTreeCacheLocator\n")
    other = run()
    assert other[0] != usual[0] and other[1:3] == ["False", "+avx2"]
    assert other[3].startswith(other[0]), "not beside the source, where any version's would lie"
    assert run(NUMBA_LOOP_VECTORIZE="1")[0] == usual[0], "a variable wins"
    file.write_text("disable_jit: 1\n")
    assert run()[1] == "True"
