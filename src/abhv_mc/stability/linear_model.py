"""Linear models of the closed loop: plant, controller, sensors and delay at each point."""

from typing import NamedTuple

from abhv_mc.array_types import Floats, Ints
from abhv_mc.stability.plant_inputs import INPUTS

# Why an input has no loop.
STUCK, NO_EFFECT = 1, 2
REASONS = {STUCK: "stuck", NO_EFFECT: "no effect"}


class Linear(NamedTuple):
    """Linear models, one per point, continuous and discrete.

    Discrete models are x+ = A x + B u, y = C x + D u at the control rate.
    """

    period: float  # s, of the control
    plant_A: (
        Floats  # [point, 10 + custom, 10 + custom] continuous, path coordinates and custom states
    )
    # [point, 10 + custom, actuator] continuous; positions of surfaces or effectors, and engine
    plant_B: Floats
    # [point, n, n] discrete: path coordinates, actuators (18 states with three surfaces), custom
    # states
    A: Floats
    B: Floats  # [point, n, input] commands
    law_A: Floats  # [point, memory, memory], sensors' states behind the law's
    law_B: Floats  # [point, memory, 10] measurement
    law_C: Floats  # [point, input, memory] commands
    law_D: Floats  # [point, input, 10]
    delay: Ints  # [point] age of the measurement, control periods
    sense: Floats  # [point, 10, n] measurement, delay apart; a frozen one is a row of zeros
    cut: Ints  # [point, input] STUCK or NO_EFFECT where an input has no loop, else 0
    phases: "tuple[Linear, ...]" = ()  # one model per tick of the period of a law of several rates
    inputs: tuple[str, ...] = INPUTS  # of the plant, which the law commands
    apart: "Linear | None" = None  # one input per effector, if the law commands mixed axes
