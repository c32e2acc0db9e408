"""Plans of shipped inputs, made once in each test process."""

from functools import cache

from abhv_mc_vehicle.flight.prepare import prepare


@cache
def prepare_once(*files):
    """Return the plan of the input files. The function can be pickled, unlike a local one."""
    return prepare(*files)
