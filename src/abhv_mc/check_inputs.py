"""Full check of input files of any kind, including the files that they refer to.

The module is that of the package ``abhv_mc_vehicle``, without which its import fails.
"""

from abhv_mc.entry_points import needs_vehicle

with needs_vehicle(__name__):
    from abhv_mc_vehicle.check_inputs import CheckedInput, check_inputs

__all__ = ["CheckedInput", "check_inputs"]
