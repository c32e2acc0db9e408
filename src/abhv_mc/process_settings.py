"""Settings of this process that save time: BLAS threads, garbage collection, and imports."""

import gc
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import LazyLoader, find_spec, module_from_spec
from typing import Any

_lock = threading.Lock()
_entered = 0  # number of open contexts
_limits: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread in this process until the last overlapping context ends.

    Threads waste processor time on small matrices.
    Programs that start with OPENBLAS_NUM_THREADS=1, such as the command line and workers, need no
    limit.
    """
    global _entered, _limits  # noqa: PLW0603  the limit applies to the process
    if os.environ.get("OPENBLAS_NUM_THREADS") == "1":
        yield
        return
    import scipy.linalg  # noqa: F401  loads SciPy's BLAS, so that it can be limited
    from threadpoolctl import threadpool_limits

    with _lock:
        if not _entered:
            _limits = threadpool_limits(1, "blas")
        _entered += 1
    try:
        yield
    finally:
        with _lock:
            _entered -= 1
            if not _entered:
                _limits.restore_original_limits()


@contextmanager
def rare_garbage_collection() -> Iterator[None]:
    """Reduce garbage collection, which would otherwise take 1/8 of the time of a report."""
    thresholds = gc.get_threshold()
    gc.set_threshold(max(100_000, thresholds[0]), 20, 20)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


def postpone_numpy_tools() -> None:
    """Load two packages of numpy on first use; scipy.special would import them without need."""
    import numpy as np

    for name in {"f2py", "testing"} - vars(np).keys():
        spec: Any = find_spec(f"numpy.{name}")
        spec.loader = LazyLoader(spec.loader)
        sys.modules[spec.name] = module = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(np, name, module)
