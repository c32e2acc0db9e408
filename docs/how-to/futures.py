"""Executor on a pool of ``concurrent.futures``, here processes of this machine: ``pool://4``."""

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager

from abhv_mc.execution.retry import FlightLostError, UnusableError
from abhv_mc.execution.worker import compute
from abhv_mc.io.input_error import InputError


class PoolExecutor:
    """Implementation of :class:`abhv_mc.interfaces.Executor` on futures.

    It does not end flights that hang.
    """

    def __init__(self, pool, workers, engine):
        self.pool, self.workers, self.engine = pool, workers, engine

    def fly(self, plan, rows, recorded=None):
        """Compute a block in a process of the pool."""
        try:
            return self.pool.submit(compute, self.engine.fly, plan, rows, recorded).result()
        except BrokenExecutor as error:  # a process died, which ends the pool
            raise UnusableError(f"the pool has ended: {error}") from None
        except Exception as error:
            raise FlightLostError(f"{type(error).__name__}: {error}") from None

    def close(self):
        """Cancel pending blocks."""
        self.pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def connect(address: str) -> Iterator:
    """Open a pool with the number of processes in the address."""
    number = address.removeprefix("pool://")
    if not number.isdecimal() or int(number) < 1:
        raise InputError("--scheduler", f"'{address}'", "pool://NUMBER, such as pool://4")
    pool = ProcessPoolExecutor(int(number))
    yield lambda engine, limit: PoolExecutor(pool, int(number), engine)
