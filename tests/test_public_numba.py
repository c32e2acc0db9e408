"""Both interfaces of numba compute equal flights.

The public one compiles for several minutes if its cache is empty, because numba optimizes each
function separately. Its vectors are half as wide on Intel processors. Neither changes a bit.
"""

import os
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
from programs import run_python

import abhv_mc

FLY = """
import sys
import numpy as np
from abhv_mc_vehicle.kernel import jit
from abhv_mc_vehicle.flight.fly import fly
from short_flights import disperse, short_plan
parts = {}
for law in ("tlc", "lqr"):
    block = fly(short_plan(800, law), disperse(20), 10)
    parts |= {f"{law} {part}": getattr(block, part) for part in ("outcome", "end_time", \
"metrics", "history")}
np.savez(sys.argv[1], compiler=jit.compiler(), **parts)
"""


def fly(out, public):
    searched = [Path(abhv_mc.__file__).parents[1], Path(__file__).parent]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, searched)),
        "ABHV_MC_PUBLIC_NUMBA": public,
    }
    if public == "1":
        environment["NUMBA_CPU_FEATURES"] = llvm.get_host_cpu_features().flatten()
    run_python("-c", FLY, out, env=environment, check=True)
    with np.load(out) as parts:
        return dict(parts)


def test_the_same_flights(tmp_path):
    private, public = fly(tmp_path / "private.npz", "0"), fly(tmp_path / "public.npz", "1")
    assert (str(private.pop("compiler")), str(public.pop("compiler"))) == ("private", "public")
    assert (
        np.ptp(private["tlc outcome"]) > 0 and len(np.unique(private["lqr metrics"], axis=0)) > 10
    )
    for name, values in private.items():
        assert np.array_equal(values, public[name], equal_nan=values.dtype.kind == "f"), name
