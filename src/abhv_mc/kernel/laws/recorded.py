"""No control law: surfaces and engine follow a recording, to replay published flights."""

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.state import XS, X

# Columns of the gains: deflections and equivalence ratio at the tick, then their slopes to the next tick.
RECORDED_GAINS = (
    *("aileron", "rudder", "elevator", "equivalence_ratio"),
    *("aileron_rate", "rudder_rate", "elevator_rate", "equivalence_ratio_rate"),
)


@lanes
def recorded_tick(plan, memory, width, tick):
    """Set surfaces and engine to the recording; the command rows hold their rates over the tick."""
    Z, gains = memory.Z, plan.gains
    for lane in range(width):
        for i in range(3):
            Z[X + s.AILERON + i, lane] = gains[tick, i]
            Z[XS + s.AILERON + i, lane] = gains[tick, i]
            Z[s.CMD + i, lane] = gains[tick, 4 + i]
        Z[X + s.ETA, lane] = gains[tick, 3]
        Z[XS + s.ETA, lane] = gains[tick, 3]
        Z[s.CMD_ETA, lane] = gains[tick, 7]
