"""Compilation of the custom code of a plan: control law, channels and vehicle functions."""

import contextlib
import re
from collections.abc import Iterator
from typing import Any

from abhv_mc.custom_code.child import in_child
from abhv_mc.custom_code.source import UserSource
from abhv_mc.entry_points import LAW_BACKENDS, load_entry_point
from abhv_mc.io.documents import Document
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc_vehicle.control.law_file import NATIVE, PYTHON, USER_LAWS
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.flight.interface import TOGETHER, UserCode
from abhv_mc_vehicle.kernel.laws.user import MAX_MEMORY, MEMORY
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import ACCELERATIONS
from abhv_mc_vehicle.user_code.compiled import compile_filter, compile_law
from abhv_mc_vehicle.user_code.effector_commands import commands_effectors
from abhv_mc_vehicle.user_code.law_interface import LastCommand, Measured
from abhv_mc_vehicle.user_code.load_law import is_number, load_law
from abhv_mc_vehicle.user_code.module import Law
from abhv_mc_vehicle.user_code.native_loop import LawBackend, find_c_memory, open_c_law
from abhv_mc_vehicle.user_code.plain_law import PlainLaw
from abhv_mc_vehicle.user_code.user_channels import compile_channels
from abhv_mc_vehicle.user_code.vehicle_functions import Functions, compile_functions
from abhv_mc_vehicle.vehicle.actuators import name_effectors

PROCESS = "process"
_ACCELERATIONS = "|".join(ACCELERATIONS)
_MORE = "|".join(Measured._fields[s.N_MEASURED :])
_REQUIREMENTS = {  # for access to the memory of a control law
    "c": "the functions abhv_law_state_get and abhv_law_state_set",
    "fmu": (
        "all memory in the Derivatives of modelDescription.xml, with initial values that can be set"
    ),
    "process": "a control law in Python or C, or an FMU",
}


@contextlib.contextmanager
def open_vehicle(plan: FlightPlan, width: int) -> Iterator[UserCode]:
    """Yield the addresses of a vehicle's custom functions for ``width`` lanes; 0 if undefined."""
    foreign = plan.vehicle.foreign
    code = plan.vehicle_code
    # The reference keeps the functions alive while the kernel uses them.
    functions = (None, None, None)
    if foreign.digest.any():
        if code is None or code.digest != foreign.digest.tobytes():
            raise ValueError("the source of the vehicle's custom functions is missing")
        functions = compile_functions(code, width)
    addresses = (0 if function is None else int(function.address) for function in functions)
    yield UserCode(0, 0, 0, 0, **dict(zip(Functions._fields, addresses, strict=True)))


@contextlib.contextmanager
def open_law(
    plan: FlightPlan,
    width: int,
    memory_in_rows: bool = False,
    flights: int = TOGETHER,
    dispersed: bool = False,
) -> Iterator[UserCode]:
    """Yield the addresses of a plan's custom code for ``width`` lanes; 0 if undefined.

    If ``memory_in_rows`` is true, control laws in plain Python or native code have their memory in
    the lane memory, like compiled control laws; see :func:`law_memory`. If ``dispersed`` is true,
    each flight has its own settings of the control law. Raise ValueError if a source is missing, as
    in a stored plan.
    """
    code = {"onboard": int(sees_onboard(plan)), "more": extra_measurements(plan)}
    runner: Any = None  # This reference keeps the control law alive while the kernel uses it.
    if plan.law == PYTHON:
        law = load_plan_law(plan)
        source = law.source
        gains = tuple(plan.gain_names.tolist())
        effectors = name_effectors(plan.vehicle) if commands_effectors(source) else ()
        if plan.around:
            runner = compile_filter(source, tuple(plan.filter_settings.tolist()), width)
        elif law.mark.compiled:
            foreign = plan.vehicle.foreign
            row = s.SETTING + foreign.settings.size + foreign.states if dispersed else 0
            runner = compile_law(source, gains, width, effectors, row)
        else:
            runner = PlainLaw(law, gains, width, memory_in_rows, effectors)
        code["address"] = int(runner.address)
    elif plan.law in NATIVE:
        lanes = max(min(flights, TOGETHER), 1)  # Later flights reuse the memory of ended flights.
        memory = len(native_memory(plan)) if memory_in_rows else None
        gains = tuple(plan.gain_names.tolist())
        n_measured = measured_count(plan)
        runner = _find_backend(plan.law, plan_source(plan).file).open(
            plan_source(plan), gains, width, lanes, memory, n_measured, name_effectors(plan.vehicle)
        )
        code |= {"address": runner.address, "context": runner.context}
    if plan.channels_hash:
        code["channels"] = int(compile_plan_channels(plan, width).address)
    try:
        with open_vehicle(plan, width) as vehicle:
            yield vehicle._replace(**code)
    finally:
        if plan.law in NATIVE:
            runner.close()


def compile_plan_channels(plan: FlightPlan, width: int) -> Any:
    """Return the compiled channels of a plan. Raise InputError if they are invalid."""
    law = load_plan_law(plan) if plan.law == PYTHON else None
    remembers = law is not None and law.mark.compiled and "memory" in law.arguments
    memory = law.memory if law is not None and remembers else None
    return compile_channels(_checked(plan.channels_source, plan.channels_hash), width, memory)


def dispersable_settings(plan: FlightPlan) -> tuple[str, ...]:
    """Return the names of the custom control law's settings that a campaign may disperse."""
    is_commanding = plan.law == PYTHON and not plan.around
    return load_plan_law(plan).mark.dispersable if is_commanding else ()


def extra_measurements(plan: FlightPlan) -> int:
    """Return 1 if the control law may read measurements other than the ten standard ones.

    Return 2 if these measurements may include accelerations, and 0 if none of them are read.
    """
    if plan.law not in USER_LAWS:
        return 0
    source = plan_source(plan)
    files = {name: content.decode(errors="replace") for name, content in source.files}
    texts = [source.text]
    before = r"\."
    copies = ""
    if plan.law == "c":
        if (source.recipe or {})["library"] is not None:
            return 2  # A compiled library may read any measurement.
        # Code that copies the whole struct may read any measurement.
        texts = [*files.values()]
        before = r"\b"
        copies = "|memcpy|memmove"
    elif plan.law == PYTHON:
        if "measured" not in load_plan_law(plan).arguments:
            return 0
        texts += [text for name, text in files.items() if name.endswith(".py")]

    def reads(names: str) -> bool:
        return any(re.search(rf"{before}({names})\b", text) for text in texts)

    return 2 if reads(_ACCELERATIONS + copies) else int(reads(_MORE))


def sees_onboard(plan: FlightPlan) -> bool:
    """Return whether the control law of a plan receives the nominal vehicle."""
    if plan.law not in NATIVE:
        return plan.law == PYTHON and "onboard" in load_plan_law(plan).arguments
    recipe = plan_source(plan).recipe or {}
    return bool(recipe.get("onboard")) or any(
        wired.startswith("onboard.") for wired in recipe.get("inputs", {}).values()
    )


def measured_count(plan: FlightPlan) -> int:
    """Return the number of measurements that the control law of a plan may read."""
    return (s.N_MEASURED, s.N_SEEN - len(ACCELERATIONS), s.N_SEEN)[extra_measurements(plan)]


def load_plan_law(plan: FlightPlan) -> Law:
    """Return the custom Python control law of a plan."""
    return load_law(plan_source(plan))


def plan_source(plan: FlightPlan) -> UserSource:
    """Return the source of a plan's custom control law. Raise ValueError if it is missing."""
    return _checked(plan.source, plan.source_hash)


def _checked(source: UserSource | None, digest: str) -> UserSource:
    if source is None or source.hash != digest:
        raise ValueError("the source of the plan's custom code is missing")
    return source


def _find_backend(law: str, file: str) -> LawBackend:
    """Return the backend of a native control law. Raise InputError if none is registered."""
    if law == "c":
        return LawBackend(open_c_law, find_c_memory)
    backend = load_entry_point(LAW_BACKENDS, law)
    if backend is None:
        raise InputError(
            file,
            f"no installed package supports control laws of kind '{law}'",
            "'law: c' or 'law: python'",
        )
    return backend


def check_native_law(document: Document, law: str, source: UserSource) -> None:
    """Raise InputErrors for entries of a controller file that contradict the native code."""
    find_misfits = _find_backend(law, source.file).find_misfits
    if find_misfits and (misfits := in_child(find_misfits, source)):
        raise InputErrors([document.error(*misfit) for misfit in misfits])


def native_memory(plan: FlightPlan) -> dict[str, float]:
    """Return the initial memory of a native control law. Raise InputError if it is hidden."""
    memory = in_child(
        _find_backend(plan.law, plan_source(plan).file).find_memory,
        plan_source(plan),
        plan.settings,
        plan.reference[0],
    )
    if memory is None:
        raise hidden_memory_error(plan)
    return memory


def hidden_memory_error(plan: FlightPlan) -> InputError:
    """Return the InputError raised if a control law to be linearized has unknown memory."""
    return InputError(
        plan_source(plan).file,
        "the memory of the control law cannot be read and set completely",
        f"{_REQUIREMENTS[plan.law]}, which linearization requires",
    )


def _python_memory(law: Law) -> dict[str, float]:
    if "memory" not in law.arguments:
        return {}
    names = getattr(law.memory, "_fields", ())
    defaults = getattr(law.memory, "_field_defaults", {})
    if (
        not names
        or len(names) > MAX_MEMORY
        or not all(is_number(defaults.get(name)) for name in names)
    ):
        raise InputError(
            law.source.file,
            "the memory of the control law in plain Python is not a NamedTuple of numbers",
            "a class Memory that is a NamedTuple of numbers, which linearization requires",
        )
    return {name: float(defaults[name]) for name in names}


def law_memory(plan: FlightPlan) -> dict[str, tuple[int, float]]:
    """Return the lane-memory row and initial value of each value in a law's memory, by name.

    The memory includes the last commands if the control law receives them (``onboard``). Raise
    InputError if the memory is hidden.
    """
    starts = native_memory(plan) if plan.law in NATIVE else _python_memory(load_plan_law(plan))
    rows = {name: (MEMORY + i, value) for i, (name, value) in enumerate(starts.items())}
    if sees_onboard(plan):
        states = plan.initial_state[[s.AILERON, s.RUDDER, s.ELEVATOR, s.ETA]].tolist()
        rows |= {
            f"onboard.last.{name}": (s.CMD + i, state)
            for i, (name, state) in enumerate(zip(LastCommand._fields, states, strict=True))
        }
    return rows
