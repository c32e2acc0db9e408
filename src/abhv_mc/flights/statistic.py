"""Statistics of metrics, and operations of the expressions that metrics evaluate."""

from enum import IntEnum

MAX_DECLARED = 48  # maximum number of metrics declared in a campaign
MAX_REGISTERS = 16


class Statistic(IntEnum):
    """Statistic of a metric's value over the control ticks of its window."""

    MIN = 0
    MAX = 1
    MAX_ABS = 2
    MEAN = 3
    RMS = 4
    FINAL = 5
    INTEGRAL = 6  # trapezoidal integral over time
    PEAK_TO_PEAK = 7
    TRAVEL = 8  # sum of absolute changes
    TIME_OUTSIDE = 9  # time for which the magnitude exceeds the limit, s
    LAST_OUTSIDE = 10  # last time outside the limit, s; start of the window if never outside
    # first time outside the limit, s; end of the window or the flight if never outside
    FIRST_OUTSIDE = 11
    REVERSALS = 12  # number of reversals larger than the limit
    SUM = 13  # sum over the control ticks
    QUANTILE = 14  # quantile over the control ticks, of the values in KernelResults.samples
    ROBUSTNESS = 15  # robustness of a formula, of the values in KernelResults.samples

    @property
    def word(self) -> str:
        """Name of the statistic in campaign files."""
        return self.name.lower()


class Operation(IntEnum):
    """Operation performed by an instruction of a metric's program."""

    LOAD = 0  # constant times the value in a row of the lane memory
    CONSTANT = 1
    ADD = 2
    SUBTRACT = 3
    MULTIPLY = 4
    DIVIDE = 5
    MINIMUM = 6
    MAXIMUM = 7
    ABSOLUTE = 8
    ROOT = 9
    SINE = 10
    COSINE = 11
    # operations on all samples of a flight, which only formulas use
    ALWAYS = 12
    EVENTUALLY = 13
    UNTIL = 14
    STEP = 15
