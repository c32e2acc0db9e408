"""Limit on the number of BLAS threads, which waste processor time on small matrices."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.Lock()
_entered = 0  # number of open contexts
_limits: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread in this process until the last overlapping context ends.

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
