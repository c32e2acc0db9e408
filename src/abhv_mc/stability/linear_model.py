"""Linear models of the closed loop: plant, controller, sensors and delay at each point."""

from typing import NamedTuple

from abhv_mc.array_types import Floats, Ints
from abhv_mc.stability.plant_inputs import INPUTS

# reasons why an input has no loop
STUCK, NO_EFFECT = 1, 2
REASONS = {STUCK: "stuck", NO_EFFECT: "no effect"}


class Linear(NamedTuple):
    """Linear models, one per point, continuous and discrete.

    Discrete models are x+ = A x + B u, y = C x + D u at the control rate.
    """

    period: float  # control period, s
    plant_A: (
        # [point, 10 + custom, 10 + custom] continuous plant in path coordinates and custom states
        Floats
    )
    # [point, 10 + custom, actuator] effect of surface (or effector) and engine positions
    plant_B: Floats
    # [point, n, n] discrete plant: path coordinates, actuators and custom states
    A: Floats
    B: Floats  # [point, n, input] effect of the commands
    law_A: Floats  # [point, memory, memory] controller's memory, with sensor states last
    law_B: Floats  # [point, memory, 10] effect of the measurement on the memory
    law_C: Floats  # [point, input, memory] commands from the memory
    law_D: Floats  # [point, input, 10] commands from the measurement
    delay: Ints  # [point] age of the measurement, control periods
    sense: Floats  # [point, 10, n] measurement without delay; a frozen one is a row of zeros
    cut: Ints  # [point, input] STUCK or NO_EFFECT if an input has no loop, else 0
    phases: "tuple[Linear, ...]" = ()  # one model per tick of the period of a multi-rate controller
    inputs: tuple[str, ...] = INPUTS  # names of the plant inputs commanded by the controller
    # model with one input per effector, if the controller commands axes
    apart: "Linear | None" = None
