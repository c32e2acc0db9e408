"""Compiled code uses the whole width of a processor's vectors, unless somebody has chosen otherwise."""

import llvmlite.binding as llvm
import numpy as np
import pytest

from abhv_mc import compiler_target
from abhv_mc.compiler_target import find_features
from abhv_mc.jit import kernel


class Features(dict):
    def flatten(self):
        return ",".join(f"{'+' if has else '-'}{name}" for name, has in self.items())


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)


def pretend(monkeypatch, features):
    monkeypatch.setattr(compiler_target.llvm, "get_host_cpu_features", lambda: Features(features))


def test_a_processor_with_512_bit_vectors_uses_them(monkeypatch):
    pretend(monkeypatch, {"avx2": True, "avx512f": True})
    assert find_features() == "+avx2,+avx512f,-prefer-256-bit"


@pytest.mark.parametrize("features", [{"avx2": True, "avx512f": False}, {"neon": True}])
def test_others_are_left_to_numba(monkeypatch, features):
    pretend(monkeypatch, features)
    assert find_features() is None


@pytest.mark.parametrize("name", ["NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"])
def test_a_user_s_choice_stands(monkeypatch, name):
    pretend(monkeypatch, {"avx512f": True})
    monkeypatch.setenv(name, "haswell")
    assert find_features() is None


def test_a_processor_that_llvm_does_not_know(monkeypatch):
    def refuse():
        raise RuntimeError("failed to get host cpu features")

    monkeypatch.setattr(compiler_target.llvm, "get_host_cpu_features", refuse)
    assert find_features() is None


@pytest.mark.skipif(not llvm.get_host_cpu_features().get("avx512f"), reason="no 512-bit vectors here")
def test_machine_code_has_them():
    @kernel
    def add(a, b):
        for i in range(a.size):
            a[i] += b[i]

    add(np.zeros(64), np.ones(64))
    (code,) = add.inspect_asm().values()
    assert "%zmm" in code
