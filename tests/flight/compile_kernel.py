"""Compile the GPU's kernel of one law to PTX, without a GPU: what test_device.py runs in a process of its own."""

import pickle
import sys
from pathlib import Path
from types import SimpleNamespace

import nvidia
from numba import cuda
from numba.cuda import dispatcher
from numba.cuda.cudadrv import libs, nvrtc
from numba.cuda.typing.typeof import typeof

from abhv_mc.flight.arguments import make_kernel_plan, make_results
from abhv_mc.flight.gpu import kernel_of
from abhv_mc.flight.plan import Recording
from abhv_mc.jit_cuda import uncontracted

COMPUTE = (9, 0)  # Hopper

# What numba-cuda asks a GPU, and a compiler that is not needed here, for.
dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=COMPUTE)
nvrtc.get_arch_option = lambda *_: "compute_90"
libdevice = next(Path(next(iter(nvidia.__path__))).rglob("libdevice.10.bc"))
libs.get_cuda_paths = lambda: {"libdevice": SimpleNamespace(info=str(libdevice))}

plan, parameters = pickle.loads(Path(sys.argv[1]).read_bytes())  # noqa: S301
arguments = make_kernel_plan(plan, parameters, Recording(10)), make_results(plan, len(parameters), Recording(10), False)
kernel = kernel_of(plan)
assert not kernel.targetoptions["lto"]  # a launch compiles through PTX, as here
with uncontracted():
    ptx, _ = cuda.compile(kernel.py_func, tuple(map(typeof, arguments)), device=False, abi="numba", cc=COMPUTE)
Path(sys.argv[2]).write_text(ptx)
