"""How far an angle cycles about its command while the reference is settled: a few numbers a lane, tick by tick.

A ripple is a swing of the error from one turning point to the next that an opposite swing of at least half its size
follows. A slow decay has no second swing, and one that decays to less than half at each swing is none either. A
settled stretch begins anew: its first swing begins at no turning point and does not count. Turbulence and sensor noise
put small wiggles on a cycle: a way back of less than 3 % of the swing, or of the one before, is no turning point.
"""

from abhv_mc.jit import lanes
from abhv_mc.numerics.angles import larger

# Rows of one angle: the last turning point, the farthest point since, the swing that led to the turning point (negative
# where it began at none, 0 without one), and the stage: 0 nothing seen, 0.5 no motion yet, +-1 moving since the
# beginning, +-2 since a turning point; its sign is that of the motion.
TURN, FARTHEST, SWING, STAGE = range(4)
N_RIPPLE_ROWS = 4
WIGGLE = 0.03  # of a swing


@lanes
def follow_ripple(Z, lane, row, error, settled):
    """The size of the swing that has just been followed by half of it, 0 without one."""
    stage, swing = Z[row + STAGE, lane], Z[row + SWING, lane]
    turn = error if stage == 0.0 else Z[row + TURN, lane]
    farthest = error if stage == 0.0 else Z[row + FARTHEST, lane]
    moving = abs(stage) >= 1.0
    way = (1.0 if stage > 0.0 else -1.0) if moving else (1.0 if error > turn else (-1.0 if error < turn else 0.0))
    size, back = abs(farthest - turn), (farthest - error) * way
    turned = moving and back > 0.0 and back >= WIGGLE * larger(size, abs(swing))
    swing = (size if abs(stage) == 2.0 else -size) if turned else swing
    turn = farthest if turned else turn
    first = way if way != 0.0 else 0.5
    stage = -2.0 * way if turned else (stage if moving else first)
    Z[row + TURN, lane] = turn
    Z[row + FARTHEST, lane] = error if turned or back < 0.0 else farthest
    Z[row + SWING, lane] = swing if settled else 0.0
    Z[row + STAGE, lane] = stage if settled else 0.0
    return swing if settled and swing > 0.0 and abs(error - turn) >= 0.5 * swing else 0.0
