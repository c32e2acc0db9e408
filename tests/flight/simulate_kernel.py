"""Fly on numba's CUDA simulator, in plain Python: what test_device.py runs in a process of its own."""

import pickle
import sys
from pathlib import Path

import numba

from abhv_mc.flight import gpu

assert numba.config.ENABLE_CUDASIM and numba.config.DISABLE_JIT

path = Path(sys.argv[1])
plans, parameters = pickle.loads(path.read_bytes())  # noqa: S301
gpu._MEMORY = 1  # bytes: one block of threads a launch
flown = {
    law: gpu.fly_on_gpu(plan, parameters, record_every=2, keep_states=True, threads=2) for law, plan in plans.items()
}
path.with_name("flown.pickle").write_bytes(pickle.dumps(flown))
