"""How far an angle cycles about its command while the reference is settled: a few numbers a lane, tick by tick.

A ripple is a swing of the error from one turning point to the next that an opposite swing of at least half its size
follows. A slow decay has no second swing, and one that decays to less than half at each swing is none either. A
settled stretch begins anew: its first swing begins at no turning point and does not count. A fast wiggle on a slow
cycle has turning points of its own and hides it.
"""

from abhv_mc.jit import lanes

# Rows of one angle: the last error, the last turning point, the swing that led to it (0 without one), and the stage:
# 0 nothing seen, 0.5 no motion yet, +-1 moving since the beginning, +-2 since a turning point.
LAST, TURN, SWING, STAGE = range(4)
N_RIPPLE_ROWS = 4


@lanes
def follow_ripple(Z, lane, row, error, settled):
    """The size of the swing that has just been followed by half of it, 0 without one."""
    stage, last, turn, swing = Z[row + STAGE, lane], Z[row + LAST, lane], Z[row + TURN, lane], Z[row + SWING, lane]
    step = error - last
    way = 1.0 if step > 0.0 else (-1.0 if step < 0.0 else 0.0)
    known = abs(stage) >= 1.0
    turned = known and way * stage < 0.0
    swing = (abs(last - turn) if abs(stage) == 2.0 else 0.0) if turned else swing
    turn = last if turned else turn
    moving = stage if known else (way if way != 0.0 else 0.5)
    stage = 2.0 * way if turned else (0.5 if stage == 0.0 else moving)
    since = abs(error - turn)
    Z[row + LAST, lane] = error
    Z[row + TURN, lane] = turn
    Z[row + SWING, lane] = swing if settled else 0.0
    Z[row + STAGE, lane] = stage if settled else 0.0
    return swing if settled and swing > 0.0 and since >= 0.5 * swing else 0.0
