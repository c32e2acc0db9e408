"""Compiled code uses the whole width of a processor's vectors, unless somebody has chosen otherwise."""

import llvmlite.binding as llvm
import numba
import numpy as np
import pytest

from abhv_mc.kernel import compiler_target, jit
from abhv_mc.kernel.compiler_target import code_folder, find_features


class Features(dict):
    def flatten(self):
        return ",".join(f"{'+' if has else '-'}{name}" for name, has in self.items())


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    for name in ("CPU_NAME", "CPU_FEATURES"):
        monkeypatch.setattr(numba.config, name, None)


@pytest.mark.parametrize(
    ("features", "chosen", "found"),
    [
        ({"avx2": True, "avx512f": True}, None, "+avx2,+avx512f,-prefer-256-bit"),
        ({"avx2": True, "avx512f": False}, None, None),  # left to numba
        ({"neon": True}, None, None),
        ({"avx512f": True}, "CPU_NAME", None),  # a user's choice stands
        ({"avx512f": True}, "CPU_FEATURES", None),
    ],
)
def test_a_processor_with_512_bit_vectors_uses_them(monkeypatch, features, chosen, found):
    monkeypatch.setattr(compiler_target.llvm, "get_host_cpu_features", lambda: Features(features))
    if chosen:
        monkeypatch.setattr(numba.config, chosen, "haswell")
    assert find_features() == found


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
