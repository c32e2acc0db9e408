"""JAX: 256 flights by ``vmap``, the ticks by ``lax.scan``, a Runge-Kutta step in each, float64, on the CPU."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.state import STATES
from benchmarks.peers.equations import ACTUATORS, RIGID, State, make_derivative, make_lqr
from benchmarks.peers.peer import main

jax.config.update("jax_enable_x64", True)

MOVED = STATES[len(RIGID) :]  # surfaces and engine
Q = RIGID.index("q0")


def make_actuators(plan: FlightPlan) -> Callable[..., tuple[State, State]]:
    """Actuators through a step between their limits: what the middle stages feel, and the end."""
    c, step = plan.vehicle.constants, plan.timing.step

    def transition(bandwidth: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
        a = np.zeros((3, 3))  # position error, rate, integral of the error
        a[0, 1], a[1, 0], a[1, 1], a[2, 0] = 1.0, -(bandwidth**2), -2.0 * damping * bandwidth, 1.0
        e = expm(a * step)
        return e[:2, :2], 0.25 * (6.0 / step * e[2, :2] - [1.0, 0.0] - e[0, :2])

    surface = transition(c.surface_bandwidth, c.surface_damping)
    engine = transition(c.engine_bandwidth, c.engine_damping)

    def run(x: State, commands: tuple) -> tuple[State, State]:
        middle, end = {}, {}
        for name, command in zip(ACTUATORS, commands, strict=True):
            e, m = engine if name == "equivalence_ratio" else surface
            error, rate = x[name] - command, x[f"{name}_rate"]
            middle[name] = command + (m[0] * error + m[1] * rate)
            end[name] = command + (e[0, 0] * error + e[0, 1] * rate)
            end[f"{name}_rate"] = e[1, 0] * error + e[1, 1] * rate
        return middle, end

    return run


def make_fly(plan: FlightPlan) -> Callable[[Any], Any]:
    """Dispersions ``[flight, parameter]`` to final states ``[flight, state]``, compiled."""
    derivative, lqr, actuators = make_derivative(plan), make_lqr(plan), make_actuators(plan)
    step, ticks = plan.timing.step, plan.timing.ticks
    rows = (jnp.asarray(plan.reference[:ticks]), jnp.asarray(plan.gains[:ticks]))
    if plan.timing.steps_per_tick != 1:
        raise ValueError("the JAX peer knows one step in a tick")

    def fly(parameters: Any) -> Any:
        def slope(
            y: Any, felt: State
        ) -> Any:  # of the rigid body, with the actuators that it feels
            x = {**dict(zip(RIGID, y, strict=True)), **felt}
            d = derivative(x, lambda name: parameters[PARAMETER_INDEX[name]])
            return jnp.stack([d[name] for name in RIGID])

        def tick(state: tuple[Any, Any], row: tuple) -> tuple[tuple[Any, Any], None]:
            y, a = state
            actuator = dict(zip(MOVED, a, strict=True))
            middle, end = actuators(
                actuator, lqr({**dict(zip(RIGID, y, strict=True)), **actuator}, *row)
            )
            k1 = slope(y, actuator)
            k2 = slope(y + 0.5 * step * k1, middle)
            k3 = slope(y + 0.5 * step * k2, middle)
            k4 = slope(y + step * k3, end)
            y = y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            attitude = y[Q : Q + 4]
            y = y.at[Q : Q + 4].set(attitude / jnp.sqrt(attitude @ attitude))
            return (y, jnp.stack([end[name] for name in MOVED])), None

        y, a = jnp.split(jnp.asarray(plan.initial_state), [len(RIGID)])
        mass = RIGID.index("mass")
        y = y.at[mass].multiply(parameters[PARAMETER_INDEX["mass.total"]])
        return jnp.concatenate(jax.lax.scan(tick, (y, a), rows)[0])

    compiled = jax.jit(jax.vmap(fly))
    return lambda parameters: np.asarray(compiled(jnp.asarray(parameters)))


if __name__ == "__main__":
    main(make_fly, "JAX vmap")
