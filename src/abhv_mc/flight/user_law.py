"""A plan's own law and channels as the kernel calls them: their addresses, which hold while it flies."""

import contextlib
import re
from collections.abc import Iterator
from typing import Any

from abhv_mc.control.law_file import USER_LAWS
from abhv_mc.entry_points import LAW_BACKENDS, load_entry_point
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.documents import Document
from abhv_mc.io.input_error import InputError, InputErrors
from abhv_mc.kernel.flight.interface import UserCode
from abhv_mc.kernel.flight.memory import TOGETHER
from abhv_mc.kernel.laws.user import MAX_MEMORY, MEMORY
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import ACCELERATIONS
from abhv_mc.user_code.c_law import find_c_memory, open_c_law
from abhv_mc.user_code.child import in_child, may_run_here
from abhv_mc.user_code.compiled import compile_filter, compile_law
from abhv_mc.user_code.effector_commands import commands_effectors
from abhv_mc.user_code.law_interface import Measured
from abhv_mc.user_code.load_law import is_number, load_law
from abhv_mc.user_code.module import Law
from abhv_mc.user_code.native_loop import LawBackend
from abhv_mc.user_code.plain_law import PlainLaw
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.user_channels import compile_channels
from abhv_mc.user_code.vehicle_functions import Functions, compile_functions
from abhv_mc.vehicle.actuators import name_effectors

PYTHON = "python"
_ACCELERATIONS = "|".join(ACCELERATIONS)
_MORE = "|".join(Measured._fields[s.N_MEASURED :])
NATIVE = tuple(law for law in USER_LAWS if law != PYTHON)


@contextlib.contextmanager
def open_vehicle(plan: FlightPlan, width: int) -> Iterator[UserCode]:
    """The functions of a plan's vehicle for ``width`` lanes, without its law; nothing for a vehicle of tables."""
    foreign, code = plan.vehicle.foreign, plan.vehicle_code
    functions: tuple[Any, ...] = (None, None, None)  # held while it flies
    if foreign.digest.any():
        if code is None or code.digest != foreign.digest.tobytes():
            raise ValueError("a plan of a vehicle with functions of its own without their source")
        functions = compile_functions(code, width)
    addresses = (0 if one is None else int(one.address) for one in functions)
    yield UserCode(0, 0, 0, 0, **dict(zip(Functions._fields, addresses, strict=True)))


@contextlib.contextmanager
def open_law(
    plan: FlightPlan,
    width: int,
    memory_in_rows: bool = False,
    flights: int = TOGETHER,
    dispersed: bool = False,
) -> Iterator[UserCode]:
    """The law and the channels of a plan for ``width`` lanes and so many flights; nothing for a plan without its own.

    ``memory_in_rows``: a law in plain Python or native code has its memory where a compiled one has it, see
    :func:`law_memory`. ``dispersed``: flights have settings of the law of their own. Raises ValueError for a plan whose
    source is missing, as of a stored one.
    """
    address, channels, context, onboard = 0, 0, 0, int(sees_onboard(plan))
    made: Any = None  # held while it flies
    if plan.law == PYTHON:
        law = load_plan_law(plan)
        source, gains = law.source, tuple(plan.gain_names.tolist())
        effectors = name_effectors(plan.vehicle) if commands_effectors(source) else ()
        if plan.around:
            made = compile_filter(source, tuple(plan.filter_settings.tolist()), width)
        elif law.mark.compiled:
            foreign = plan.vehicle.foreign
            row = s.SETTING + foreign.settings.size + foreign.states if dispersed else 0
            made = compile_law(source, gains, width, effectors, row)
        else:
            made = PlainLaw(law, gains, width, memory_in_rows, effectors)
        address = int(made.address)
    elif plan.law in NATIVE:
        places = -(-max(min(flights, TOGETHER), 1) // width) * width  # more are flown after these
        memory = len(native_memory(plan)) if memory_in_rows else None
        gains, seen = tuple(plan.gain_names.tolist()), measured_count(plan)
        made = _find_backend(plan.law, plan_source(plan).file).open(
            plan_source(plan), gains, width, places, memory, seen, name_effectors(plan.vehicle)
        )
        address, context = made.address, made.context
    if plan.channels_hash:
        channels = int(compile_plan_channels(plan, width).address)
    try:
        with open_vehicle(plan, width) as vehicle:
            yield vehicle._replace(
                address=address,
                onboard=onboard,
                channels=channels,
                more=asks_for_more(plan),
                context=context,
            )
    finally:
        if plan.law in NATIVE:
            made.close()


def compile_plan_channels(plan: FlightPlan, width: int) -> Any:
    """Return the compiled channels of a plan. Raise InputError."""
    law = load_plan_law(plan) if plan.law == PYTHON else None
    remembers = law is not None and law.mark.compiled and "memory" in law.arguments
    memory = law.memory if law is not None and remembers else None
    return compile_channels(_checked(plan.channels_source, plan.channels_hash), width, memory)


def dispersable_settings(plan: FlightPlan) -> tuple[str, ...]:
    """Names of the settings of a plan's own law that a campaign may disperse."""
    own = plan.law == PYTHON and not plan.around
    return load_plan_law(plan).mark.dispersable if own else ()


def asks_for_more(plan: FlightPlan) -> int:
    """Return 1 if the plan's law may read values beyond the ten that every law is given.

    Return 2 if accelerations may be among them, 0 if there are none.
    """
    if plan.law not in USER_LAWS:
        return 0
    source = plan_source(plan)
    files = {name: content.decode(errors="replace") for name, content in source.files}
    texts, before, copies = [source.text], r"\.", ""
    if plan.law == "c":
        if (source.recipe or {})["library"] is not None:
            return 2  # a library does not say what it reads
        texts, before, copies = [*files.values()], r"\b", "|memcpy|memmove"  # of the whole struct
    elif plan.law == PYTHON:
        if "measured" not in load_plan_law(plan).arguments:
            return 0
        texts += [text for name, text in files.items() if name.endswith(".py")]

    def reads(names: str) -> bool:
        return any(re.search(rf"{before}({names})\b", text) for text in texts)

    return 2 if reads(_ACCELERATIONS + copies) else int(reads(_MORE))


def sees_onboard(plan: FlightPlan) -> bool:
    """Whether the plan's law is given the nominal vehicle."""
    if plan.law not in NATIVE:
        return plan.law == PYTHON and "onboard" in load_plan_law(plan).arguments
    recipe = plan_source(plan).recipe or {}
    return bool(recipe.get("onboard")) or any(
        wired.startswith("onboard.") for wired in recipe.get("inputs", {}).values()
    )


def measured_count(plan: FlightPlan) -> int:
    """How many measured values the plan's law may look at."""
    return (s.N_MEASURED, s.N_SEEN - len(ACCELERATIONS), s.N_SEEN)[asks_for_more(plan)]


def load_plan_law(plan: FlightPlan) -> Law:
    """The law of a plan that has its own."""
    return load_law(plan_source(plan))


def plan_source(plan: FlightPlan) -> UserSource:
    """The code of a plan that has its own, of any kind."""
    return _checked(plan.source, plan.source_hash)


def _checked(source: UserSource | None, digest: str) -> UserSource:
    if source is None or source.hash != digest:
        raise ValueError("a plan of the user's own code without its source")
    return source


def _find_backend(law: str, file: str) -> LawBackend:
    """Return the backend of a native law. Raises InputError if no installed package registers it."""
    if law == "c":
        return LawBackend(open_c_law, find_c_memory)
    backend: LawBackend | None = load_entry_point(LAW_BACKENDS, law)
    if backend is None:
        found = f"a law of the kind '{law}', which no installed package knows"
        raise InputError(file, found, "'law: c' or 'law: python'")
    return backend


def refuse_misfits(document: Document, law: str, source: UserSource) -> None:
    """Raise InputErrors with the places in a controller file that do not fit the native law that it names."""
    find = _find_backend(law, source.file).find_misfits
    if find and (found := in_child(find, source)):
        raise InputErrors([document.error(*each) for each in found])


def native_memory(plan: FlightPlan) -> dict[str, float]:
    """The numbers that a law in native code remembers, as a flight starts. Raises InputError where it hides them."""
    found = in_child(
        _find_backend(plan.law, plan_source(plan).file).find_memory,
        plan_source(plan),
        plan.settings,
        plan.reference[0],
    )
    if found is None:
        raise hidden_memory(plan)
    return found


def hidden_memory(plan: FlightPlan) -> InputError:
    """What to raise where slopes are asked of a law whose memory is not known."""
    words = {
        "c": "a law whose memory is not known",
        "fmu": "an FMU that remembers more than states that can be set",
    }
    needed = {
        "c": "abhv_law_state_get and abhv_law_state_set",
        "fmu": "all that it remembers in its modelDescription's Derivatives, with start values that can be set",
    }
    return InputError(plan_source(plan).file, words[plan.law], f"{needed[plan.law]}, for slopes")


def must_fly_elsewhere(plan: FlightPlan) -> bool:
    """Whether the plan's law is native code, and this process not one that may be lost."""
    return plan.law in NATIVE and not may_run_here()


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
        found = "a law in plain Python whose memory is no NamedTuple of numbers"
        raise InputError(law.source.file, found, "such a Memory, of which slopes can be taken")
    return {name: float(defaults[name]) for name in names}


def law_memory(plan: FlightPlan) -> dict[str, tuple[int, float]]:
    """Row of the lane memory and value at the start of each number that the plan's own law remembers, by its name.

    The last commands are among them where the law sees them (``onboard``). Raises InputError for a hidden memory.
    """
    starts = native_memory(plan) if plan.law in NATIVE else _python_memory(load_plan_law(plan))
    rows = {name: (MEMORY + i, value) for i, (name, value) in enumerate(starts.items())}
    if sees_onboard(plan):
        last = {
            "onboard.last.aileron": (s.CMD_AILERON, s.AILERON),
            "onboard.last.rudder": (s.CMD_RUDDER, s.RUDDER),
            "onboard.last.elevator": (s.CMD_ELEVATOR, s.ELEVATOR),
            "onboard.last.equivalence_ratio": (s.CMD_ETA, s.ETA),
        }
        rows |= {
            name: (row, float(plan.initial_state[state])) for name, (row, state) in last.items()
        }
    return rows
