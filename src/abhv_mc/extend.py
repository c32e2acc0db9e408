"""What a user's own controller or channel is written with; ``docs/tutorials/own-controller.md`` shows how.

A law sees one flight at one control tick: named tuples of floats in SI and radians, wired by name. What is imported
from here works alike compiled in lanes and in plain Python, to the last bit.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

from abhv_mc.kernel.jit import scalar
from abhv_mc.kernel.laws.allocation import solve_3x3
from abhv_mc.kernel.numerics.angles import clamp, larger, smaller, wrap
from abhv_mc.kernel.numerics.lane_math import acos, asin, atan2, exp, log, power, sincos, tan
from abhv_mc.user_code.law_interface import (
    Coefficients,
    Command,
    Effect,
    Filtered,
    Inertia,
    Measured,
    Moment,
    Onboard,
    Reference,
    Sensed,
    Thrust,
)
from abhv_mc.user_code.module import CHANNEL, CONTROLLER, DYNAMICS, ChannelMark, ControllerMark
from abhv_mc.user_code.small_matrices import cholesky, matmul, solve
from abhv_mc.user_code.table import Scattered as scattered  # noqa: N813  spoken as functions
from abhv_mc.user_code.table import Table as table  # noqa: N813

__all__ = [
    "Coefficients",
    "Command",
    "Effect",
    "Filtered",
    "Inertia",
    "Measured",
    "Moment",
    "Onboard",
    "Reference",
    "Sensed",
    "Thrust",
    "acos",
    "allocate",
    "asin",
    "atan2",
    "channel",
    "cholesky",
    "clamp",
    "controller",
    "cos",
    "dynamics",
    "exp",
    "larger",
    "log",
    "matmul",
    "measurement_filter",
    "power",
    "scattered",
    "sin",
    "sincos",
    "smaller",
    "solve",
    "sqrt",
    "table",
    "tan",
    "wrap",
]

F = TypeVar("F", bound=Callable[..., Any])


def controller(
    function: F | None = None,
    *,
    units: dict[str, str] | None = None,
    compiled: bool = True,
    dispersable: tuple[str, ...] = (),
) -> Any:
    """Mark the one function of a file that is its control law.

    ``units`` of the settings that have one: YAML must give them with it. ``compiled=False`` calls the law in plain
    Python, a thousand times slower: for prototypes, with any library. ``dispersable`` names settings that a campaign
    may disperse as ``law.NAME``.
    """

    def mark(law: F) -> F:
        setattr(law, CONTROLLER, ControllerMark(dict(units or {}), compiled, tuple(dispersable)))
        return law

    return mark if function is None else mark(function)


def channel(*, unit: str) -> Callable[[F], F]:
    """Mark a function that gives one number a control tick: a channel of the function's name and this unit."""

    def mark(function: F) -> F:
        doc = (function.__doc__ or function.__name__.replace("_", " ")).strip().splitlines()[0]
        setattr(function, CHANNEL, ChannelMark(unit, function.__name__, doc))
        return function

    return mark


def measurement_filter(function: F | None = None, *, units: dict[str, str] | None = None) -> Any:
    """Mark the one function of a file that filters the measurement of TLC or LQR: it returns a :class:`Filtered`.

    A filter with a class ``Memory`` returns ``Filtered(...), Memory(...)``. ``units`` as of :func:`controller`.
    """

    def mark(law: F) -> F:
        setattr(law, CONTROLLER, ControllerMark(dict(units or {}), filters=True))
        return law

    return mark if function is None else mark(function)


def dynamics(function: F) -> F:
    """Mark the one function of a file that is a vehicle's custom dynamics: it returns an :class:`Effect`."""
    setattr(function, DYNAMICS, True)
    return function


@scalar
def sqrt(x: float) -> float:
    """Square root; NaN below zero."""
    return math.sqrt(x) if x >= 0.0 else math.nan


@scalar
def sin(x: float) -> float:
    """Sine of x in radians."""
    return sincos(x)[0]


@scalar
def cos(x: float) -> float:
    """Cosine of x in radians."""
    return sincos(x)[1]


@scalar
def allocate(onboard: Onboard, roll: float, pitch: float, yaw: float) -> tuple[float, float, float]:
    """Changes of aileron, rudder and elevator (rad) that add a moment (N m) to that of the last command."""
    a, r, e = onboard.moment_by_aileron, onboard.moment_by_rudder, onboard.moment_by_elevator
    return solve_3x3(
        a.roll, r.roll, e.roll, a.pitch, r.pitch, e.pitch, a.yaw, r.yaw, e.yaw, roll, pitch, yaw
    )
