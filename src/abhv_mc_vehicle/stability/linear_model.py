"""Linear models of the closed loop: plant, controller, sensors and delay at each point."""

from typing import NamedTuple

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.stability.plant_inputs import INPUTS

# reasons why an input has no loop
STUCK, NO_EFFECT = 1, 2
REASONS = {STUCK: "stuck", NO_EFFECT: "no effect"}


class Linear(NamedTuple):
    """Continuous and discrete linear models, one per point.

    Discrete models are x+ = A x + B u, y = C x + D u at the control rate.
    """

    period: float  # control period, s
    plant_A: (
        # [point, 10 + custom, 10 + custom] continuous plant; states: path coordinates, custom
        # states
        Floats
    )
    # [point, 10 + custom, actuator] effect of the positions of surfaces (or effectors) and engine
    plant_B: Floats
    # [point, n, n] discrete plant; states: path coordinates, actuators, custom states
    A: Floats
    B: Floats  # [point, n, input] effect of the commands
    # [point, memory, memory] dynamics of the controller's memory, with sensor states last
    law_A: Floats
    law_B: Floats  # [point, memory, 10] effect of the measurement on the memory
    law_C: Floats  # [point, input, memory] effect of the memory on the commands
    law_D: Floats  # [point, input, 10] effect of the measurement on the commands
    delay: Ints  # [point] delay of the measurement, control periods
    # [point, 10, n] measurement without delay; the row of a frozen measurement is zero
    sense: Floats
    cut: Ints  # [point, input] STUCK or NO_EFFECT if an input has no loop, else 0
    phases: "tuple[Linear, ...]" = ()  # one model per tick of a multi-rate controller's period
    inputs: tuple[str, ...] = INPUTS  # names of the plant inputs commanded by the controller
    # model with one input per effector, if the controller commands axes
    apart: "Linear | None" = None
