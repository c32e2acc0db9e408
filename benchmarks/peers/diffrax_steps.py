"""diffrax: 256 flights by ``vmap``; diffrax's own Runge-Kutta machinery takes the steps, with the classical tableau.

The state is one vector of 22, actuators included, so their steps are of order 4 and not exact. The law is evaluated
between the steps ("manual stepping" in diffrax's documentation), which spares one ``diffeqsolve`` a tick.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.state import STATES
from benchmarks.peers.equations import ACTUATORS, make_derivative, make_lqr
from benchmarks.peers.peer import main

jax.config.update("jax_enable_x64", True)


class ClassicalRungeKutta(diffrax.AbstractERK):
    """Order 4, fixed steps, no error estimate."""

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        c=np.array([0.5, 0.5, 1.0]),
        b_sol=np.array([1.0, 2.0, 2.0, 1.0]) / 6.0,
        b_error=np.zeros(4),
        a_lower=(np.array([0.5]), np.array([0.0, 0.5]), np.array([0.0, 0.0, 1.0])),
    )
    interpolation_cls: ClassVar[Callable[..., Any]] = (
        diffrax.ThirdOrderHermitePolynomialInterpolation.from_k
    )

    def order(self, terms: Any) -> int:
        return 4


def make_fly(plan: FlightPlan) -> Callable[[Any], Any]:
    """Dispersions ``[flight, parameter]`` to final states ``[flight, state]``, compiled."""
    derivative, lqr = make_derivative(plan), make_lqr(plan)
    c, step, ticks = plan.vehicle.constants, plan.timing.step, plan.timing.ticks
    rows = (jnp.asarray(plan.reference[:ticks]), jnp.asarray(plan.gains[:ticks]))
    if plan.timing.steps_per_tick != 1:
        raise ValueError("the diffrax peer knows one step in a tick")

    def slope(_: Any, y: Any, arguments: tuple) -> Any:
        parameters, commands = arguments
        x = dict(zip(STATES, y, strict=True))
        d = derivative(x, lambda name: parameters[PARAMETER_INDEX[name]])
        for name, command in zip(ACTUATORS, commands, strict=True):
            engine = name == "equivalence_ratio"
            bandwidth = c.engine_bandwidth if engine else c.surface_bandwidth
            damping = c.engine_damping if engine else c.surface_damping
            rate = x[f"{name}_rate"]
            d[name] = rate
            d[f"{name}_rate"] = (
                bandwidth**2 * (command - x[name]) - 2.0 * damping * bandwidth * rate
            )
        return jnp.stack([d[name] for name in STATES])

    term, solver = diffrax.ODETerm(slope), ClassicalRungeKutta()

    def fly(parameters: Any) -> Any:
        def tick(y: Any, row: tuple) -> tuple[Any, None]:
            arguments = (parameters, lqr(dict(zip(STATES, y, strict=True)), *row))
            y, *_ = solver.step(term, 0.0, step, y, arguments, (False, None), made_jump=False)
            q = STATES.index("q0")
            attitude = y[q : q + 4]
            return y.at[q : q + 4].set(attitude / jnp.sqrt(attitude @ attitude)), None

        start = jnp.asarray(plan.initial_state)
        mass = STATES.index("mass")
        start = start.at[mass].multiply(parameters[PARAMETER_INDEX["mass.total"]])
        return jax.lax.scan(tick, start, rows)[0]

    compiled = jax.jit(jax.vmap(fly))
    return lambda parameters: np.asarray(compiled(jnp.asarray(parameters)))


if __name__ == "__main__":
    main(make_fly, "diffrax")
