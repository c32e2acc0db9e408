"""The graphics processor's side of :mod:`abhv_mc.jit`: numba-cuda, and how its kernels are compiled.

Only what flies on a GPU imports this. A kernel calls the very functions that the processor runs: numba-cuda compiles
them as device functions. Tests set ``NUMBA_ENABLE_CUDASIM`` and get the simulator in plain Python.
"""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numba.cuda

import abhv_mc.jit  # noqa: F401  sets numba's cache folder: kernels for the GPU lie there, too
from abhv_mc.io.input_error import Refusal

cuda: Any = numba.cuda
config: Any = numba.config

F = TypeVar("F", bound=Callable[..., Any])

SIMULATED = bool(config.ENABLE_CUDASIM)

config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # a small campaign is no mistake


def find_device() -> str:
    """Name of the GPU that will fly. Raises Refusal where there is none, or no numba-cuda to drive it."""
    if SIMULATED:
        return "simulator"
    if importlib.util.find_spec("numba_cuda") is None:
        raise Refusal("no numba-cuda, which flights on a GPU need", "pip install 'abhv-mc[gpu]', or --device cpu")
    if not cuda.is_available():
        raise Refusal("no NVIDIA GPU that CUDA can use on this machine", "a GPU with its driver, or --device cpu")
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


def device_kernel(function: F, max_registers: int | None = None) -> F:
    """Compile a kernel at its first launch: cached on disk, at most ``max_registers`` registers a thread.

    Without optimization at link time, which would fuse what :func:`uncontracted` keeps apart.
    """
    options = {} if SIMULATED else {"cache": True, "lto": False, "max_registers": max_registers}
    return cast("F", cuda.jit(function, **options))  # as a decorator with options it would drop lto


@contextlib.contextmanager
def uncontracted() -> Iterator[None]:
    """Whatever is compiled inside rounds after every operation, as the processor's code does.

    libNVVM otherwise turns ``a * b + c`` into a fused multiply-add, and numba-cuda has no switch for it. One thread
    at a time.
    """
    if SIMULATED:
        yield
        return
    from numba.cuda.cudadrv import nvvm

    before = nvvm.compile_ir

    def compile_ir(modules: Any, **options: Any) -> Any:
        return before(modules, **{**options, "fma": False})

    nvvm.compile_ir = compile_ir  # type: ignore[assignment]
    try:
        yield
    finally:
        nvvm.compile_ir = before
