"""Interface for custom control laws, filters, channels and vehicle functions.

The module is that of the package ``abhv_mc_vehicle``, without which its import fails.
"""

from abhv_mc.entry_points import needs_vehicle

with needs_vehicle(__name__):
    from abhv_mc_vehicle.extend import *  # noqa: F403
    from abhv_mc_vehicle.extend import __all__ as __all__  # noqa: PLC0414
    from abhv_mc_vehicle.extend import __doc__ as __doc__  # noqa: A004, PLC0414
