"""Executor on a local process pool of ``concurrent.futures``, for addresses like ``pool://4``."""

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager

from abhv_mc.execution.retry import FlightLostError, UnusableError
from abhv_mc.execution.worker import compute
from abhv_mc.io.messages import InputError


class PoolExecutor:
    """Implementation of :class:`abhv_mc.interfaces.Executor` with futures.

    Unlike the executors of abhv-mc, this example does not end flights that hang, waits for the
    flights in progress when the program ends, and stops the run if a process dies.
    """

    def __init__(self, pool, workers, engine):
        self.pool, self.workers, self.engine = pool, workers, engine

    def fly(self, plan, rows, recorded=None):
        """Compute a block of flights in a process of the pool."""
        try:
            return self.pool.submit(compute, self.engine.fly, plan, rows, recorded).result()
        except BrokenExecutor as error:  # a dead process makes the pool unusable
            raise UnusableError(f"the process pool is broken: {error}") from None
        except Exception as error:
            raise FlightLostError(f"{type(error).__name__}: {error}") from None

    def close(self):
        """Cancel pending blocks and shut down the pool."""
        self.pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def connect(address: str) -> Iterator:
    """Open a pool with the number of processes that the address specifies."""
    number = address.removeprefix("pool://")
    if not number.isdecimal() or int(number) < 1:
        raise InputError(
            "--scheduler", f"invalid address '{address}'", "pool://NUMBER, such as pool://4"
        )
    pool = ProcessPoolExecutor(int(number))
    yield lambda engine, limit: PoolExecutor(pool, int(number), engine)
