"""Interface for custom control laws, filters, channels and vehicle functions.

A control law is a Python function that is called once per control tick of a flight. Its arguments
are named tuples of floats in SI units and radians, passed by name. The functions of this module
return bit-identical results in compiled code and in plain Python. The page
``docs/tutorials/own-controller.md`` is an introduction.

============================================= =====================================================
``controller``, ``measurement_filter``,       decorators for the function of a file
``dynamics``, ``channel``
``Measured``, ``Reference``, ``Onboard``,     arguments of laws, with ``Moment`` and ``Inertia``
``Command``, ``Filtered``                     results of a law and of a filter
``Coefficients``, ``Thrust``, ``Effect``,     results of aerodynamics, engine and custom dynamics
``Sensed``
``sqrt``, ``exp``, ``log``, ``power``         elementary functions of floats
``sin``, ``cos``, ``sincos``, ``tan``,        trigonometric functions, in radians
``asin``, ``acos``, ``atan2``
``clamp``, ``larger``, ``smaller``, ``wrap``  limits, and angles in [-pi, pi]
``table``, ``scattered``, ``allocate``        look-ups and control allocation
============================================= =====================================================

Examples
--------
A control law that adds pitch damping to the reference elevator:

>>> from typing import NamedTuple
>>> class Settings(NamedTuple):
...     damping: float = 0.5
>>> @controller
... def law(measured, reference, settings):
...     elevator = reference.elevator + settings.damping * measured.pitch_rate
...     return Command(0.0, 0.0, elevator, reference.equivalence_ratio)
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

from abhv_mc_vehicle.kernel.jit import scalar
from abhv_mc_vehicle.kernel.laws.allocation import solve_3x3
from abhv_mc_vehicle.kernel.numerics.lane_math import (
    acos,
    asin,
    atan2,
    clamp,
    exp,
    larger,
    log,
    power,
    sincos,
    smaller,
    tan,
    wrap,
)
from abhv_mc_vehicle.user_code.law_interface import (
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
from abhv_mc_vehicle.user_code.module import (
    CHANNEL,
    CONTROLLER,
    DYNAMICS,
    ControllerMark,
)
from abhv_mc_vehicle.user_code.small_matrices import cholesky, matmul, solve
from abhv_mc_vehicle.user_code.table import Scattered as scattered  # noqa: N813  used like functions
from abhv_mc_vehicle.user_code.table import Table as table  # noqa: N813

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
    """Mark a function as the control law of its file.

    Parameters
    ----------
    function
        Control law; its arguments are passed by name.
    units
        Units of settings, by name; the YAML file must give these settings with a unit.
    compiled
        If False, the law runs in plain Python; it is then a thousand times slower, but may use any
        library.
    dispersable
        Settings that a campaign may disperse as ``law.NAME``.

    Returns
    -------
    function
        The same function, or a decorator if no function is given.

    Examples
    --------
    >>> @controller(units={"lag": "s"}, dispersable=("lag",))
    ... def law(measured, reference, settings):
    ...     return Command(0.0, 0.0, reference.elevator)
    """

    def mark(law: F) -> F:
        setattr(law, CONTROLLER, ControllerMark(dict(units or {}), compiled, tuple(dispersable)))
        return law

    return mark if function is None else mark(function)


def channel(*, unit: str) -> Callable[[F], F]:
    """Mark a function that computes the custom channel of the same name.

    Parameters
    ----------
    unit
        Unit of the returned number.

    Returns
    -------
    callable
        Decorator for a function of ``measured``, ``reference`` and other arguments of a law, which
        is called once per control tick.

    Examples
    --------
    >>> @channel(unit="Pa")
    ... def dynamic_pressure(onboard):
    ...     return onboard.dynamic_pressure
    """

    def mark(function: F) -> F:
        setattr(function, CHANNEL, unit)
        return function

    return mark


def measurement_filter(function: F | None = None, *, units: dict[str, str] | None = None) -> Any:
    """Mark a function as the measurement filter of TLC or LQR.

    Parameters
    ----------
    function
        Filter that returns a :class:`Filtered`, and also the new ``Memory`` if the file defines a
        class ``Memory``.
    units
        Units of settings; see :func:`controller`.

    Returns
    -------
    function
        The same function, or a decorator if no function is given.

    Examples
    --------
    >>> @measurement_filter
    ... def without_bias(measured):
    ...     return Filtered(sideslip=measured.sideslip - 0.001)
    """

    def mark(law: F) -> F:
        setattr(law, CONTROLLER, ControllerMark(dict(units or {}), filters=True))
        return law

    return mark if function is None else mark(function)


def dynamics(function: F) -> F:
    """Mark a function as the custom dynamics of a vehicle.

    Parameters
    ----------
    function
        Function that returns an :class:`Effect`: the rates of the custom states, and the loads on
        the vehicle.

    Returns
    -------
    function
        The same function.

    Examples
    --------
    >>> @dynamics
    ... def gear(states, motion):
    ...     return Effect(rates=(), force=(-50.0 * motion.u, 0.0, 0.0))
    """
    setattr(function, DYNAMICS, True)
    return function


@scalar
def sqrt(x: float) -> float:
    """Return the square root of x, or NaN if x is negative."""
    return math.sqrt(x) if x >= 0.0 else math.nan


@scalar
def sin(x: float) -> float:
    """Return the sine of x, an angle in radians."""
    return sincos(x)[0]


@scalar
def cos(x: float) -> float:
    """Return the cosine of x, an angle in radians."""
    return sincos(x)[1]


@scalar
def allocate(onboard: Onboard, roll: float, pitch: float, yaw: float) -> tuple[float, float, float]:
    """Return the changes of the deflections that produce an additional moment.

    Parameters
    ----------
    onboard
        Nominal vehicle with the control derivatives of the moments.
    roll, pitch, yaw
        Moment to add to the moment of the last command, N m.

    Returns
    -------
    tuple of float
        Changes of aileron, rudder and elevator, rad.

    Examples
    --------
    In a law: ``aileron, rudder, elevator = allocate(onboard, 0.0, 2e5, 0.0)``.
    """
    a = onboard.moment_by_aileron
    r = onboard.moment_by_rudder
    e = onboard.moment_by_elevator
    return solve_3x3(
        a.roll, r.roll, e.roll, a.pitch, r.pitch, e.pitch, a.yaw, r.yaw, e.yaw, roll, pitch, yaw
    )
