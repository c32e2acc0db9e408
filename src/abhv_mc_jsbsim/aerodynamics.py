"""Aerodynamics of a JSBSim model as one Python function that returns coefficients.

A force is ``qbar S`` times its coefficient, and a moment is also multiplied by a length. Most
functions of a model are products with these factors, which are omitted; other functions are divided
by these factors.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from abhv_mc.io.messages import one_of, quoted
from abhv_mc.io.xml_reader import Node
from abhv_mc_jsbsim.expressions import Expressions, factors_of, operand_of, property_of
from abhv_mc_jsbsim.properties import (
    AREA,
    CHORD,
    CONSTANTS,
    DYNAMIC_PRESSURE,
    GROUND,
    LIFT_SQUARED,
    NORMS,
    PRESSURE_AREA,
    PROPERTIES,
    REDUCED,
    SPAN,
    UNKNOWN_RATES,
)
from abhv_mc_vehicle.imported_vehicle import RESERVED, tidy
from abhv_mc_vehicle.user_code.module_text import INDENT, WIDTH, Line, free_name, number

# Frame, and sign and coefficient of each axis, by the names of force axes.
_FRAMES = {
    ("LIFT", "DRAG"): ("wind", {"LIFT": ("", "CL"), "DRAG": ("", "CD"), "SIDE": ("", "CC")}),
    ("AXIAL", "NORMAL"): (
        "body", {"AXIAL": ("-", "CX"), "NORMAL": ("-", "CZ"), "SIDE": ("", "CY")}),
    ("X", "Y", "Z"): ("body", {"X": ("", "CX"), "Y": ("", "CY"), "Z": ("", "CZ")}),
}  # fmt: skip
_STABILITY = {"LIFT": ("", "CL"), "DRAG": ("", "CD"), "SIDE": ("", "CY")}
_MOMENTS = {"ROLL": ("Cl", SPAN), "PITCH": ("Cm", CHORD), "YAW": ("Cn", SPAN)}
# names that the generated module must not define again
_TAKEN = RESERVED | {
    *CONSTANTS, "Settings", "Coefficients", "coefficients", "air", "controls", "rates", "settings",
    "cl_squared",
}  # fmt: skip
_LEFT_OUT = {
    "alphalimits": "limits of the angle of attack",
    "hysteresis_limits": "hysteresis of the stall",
    "aero_ref_pt_shift_x": "shift of the reference point",
}


@dataclass
class Setting:
    """Constant for a property that abhv-mc does not model, with the functions that use it."""

    key: str
    value: float
    used_by: list[str] = field(default_factory=list)


class Aerodynamics:
    """Aerodynamic functions of a model, in order of dependence."""

    def __init__(
        self,
        node: Node,
        metrics: dict[str, float],
        values: dict[str, float],
        full_deflections: dict[str, float],
    ) -> None:
        """Read the functions of the element ``node``.

        The keys of ``metrics``, ``values`` and ``full_deflections`` (rad) are property names.
        """
        self.settings: dict[str, Setting] = {}  # settings by property
        self.notes: list[str] = []
        self.body: list[Line] = []
        self._taken = set(_TAKEN)
        self._expressions = Expressions(self._resolve, self._taken)
        self._known = metrics
        self._values = values
        self._full = full_deflections
        self._functions: dict[str, tuple[Node, str | None]] = {}  # function and axis, by property
        self._done: dict[str, str] = {}  # expression of each property that has been read
        self._pending: list[str] = []
        self._terms: dict[str, list[str]] = {}  # names of the coefficients that are added, by axis
        axes = {}
        for child in node.children:
            if child.name in _LEFT_OUT:
                self.notes.append(_LEFT_OUT[child.name])
            elif child.name == "function":
                self._add(child, None)
            elif child.name == "axis":
                axes[child.attributes.get("name", "")] = child
        self.frame, self._coefficients = self._choose_frame(node, axes)
        for name, axis in axes.items():
            self._terms[name] = []
            for function in axis.all("function"):
                self._add(function, name)
        for name in self._functions:
            self._read(name)
        self.notes = list(dict.fromkeys(self.notes))
        self.body += [Line(f"return Coefficients({', '.join(self._sums(axes))})")]

    @property
    def tables(self) -> list[Line]:
        """Python statements that define the tables."""
        return self._expressions.tables

    def _choose_frame(
        self, node: Node, axes: dict[str, Node]
    ) -> tuple[str, dict[str, tuple[str, str]]]:
        forces = [name for name in axes if name not in _MOMENTS]
        match = next((layout for names, layout in _FRAMES.items() if {*names} & {*forces}), None)
        if match is None:
            raise node.refuse(
                f"found the {'axis' if len(axes) == 1 else 'axes'} {quoted(axes)}",
                "the axes 'LIFT', 'DRAG' and 'SIDE', or those of another frame",
            )
        frame, names = match
        for name, axis in axes.items():
            if name not in names and name not in _MOMENTS:
                raise axis.refuse(
                    f"found the axis '{name}' together with {quoted(forces)}",
                    one_of((*names, *_MOMENTS), name),
                )
            frame_name = axis.attributes.get("frame", "")
            natural = {"BODY"} if name in _MOMENTS or frame == "body" else {"WIND", "STABILITY"}
            if frame_name and frame_name not in natural:
                raise axis.refuse(
                    f"found the axis '{name}' in the frame '{frame_name}'",
                    one_of(natural, frame_name),
                )
            if axis.attributes.get("unit", "LBS") not in ("LBS", "LBSFT", "LBS*FT", "FT*LBS"):
                raise axis.refuse(f"found the unit '{axis.attributes['unit']}'", "LBS")
            if frame_name == "STABILITY":
                frame = "stability"
                names = _STABILITY
        return frame, names

    def _add(self, function: Node, axis: str | None) -> None:
        name = function.attributes.get("name", "").replace(" ", "-")
        if not name or name in self._functions:
            name += f"-{function.line}"
        self._functions[name] = (function, axis)

    def _read(self, name: str) -> str:
        """Add a function after its dependencies, and return the expression of its value."""
        if name in self._done:
            return self._done[name]
        function, axis = self._functions[name]
        if name in self._pending:
            raise function.refuse(
                f"'{name}' depends on itself", "functions without circular dependence"
            )
        self._pending.append(name)
        key = free_name(name.rpartition("/")[2], self._taken)
        self._taken.add(key)
        operand = operand_of(function)
        value = key
        if axis is None:
            text = tidy(operand, self._expressions.value(operand, key))
        else:
            text = self._coefficient(operand, key, axis)
            self._terms[axis].append(key)
            scale = f"air.dynamic_pressure / PSF * {number(self._known[AREA])}"
            length = f" * {number(self._known[_MOMENTS[axis][1]])}" if axis in _MOMENTS else ""
            value = f"({key} * {scale}{length})"
        description = function.words("description").replace("_", " ")
        too_long = len(f"{INDENT}{key} = {text}") > WIDTH
        self.body.append(Line(f"{key} = {f'({text})' if too_long else text}", description or name))
        self._pending.pop()
        self._done[name] = value
        return value

    def _coefficient(self, operand: Node, key: str, axis: str) -> str:
        """Return a function without its factors of dynamic pressure, area and length."""
        factors = factors_of(operand)
        names = [property_of(f)[1] if f.name in ("property", "p") else "" for f in factors]
        length = self._known[_MOMENTS[axis][1]] if axis in _MOMENTS else 1.0
        if (rate := next((name for name in UNKNOWN_RATES if name in names), None)) is not None:
            if all(
                factor.number(factor.text) for factor in factors if factor.name in ("value", "v")
            ):
                self.notes.append(f"{rate} of {self._pending[-1]}, which is set to 0")
            return "0.0"
        if PRESSURE_AREA not in names and not {DYNAMIC_PRESSURE, AREA} <= set(names):
            scale = number(self._known[AREA] * length)
            text = self._expressions.value(operand, key)
            return tidy(operand, f"{text} / (larger(air.dynamic_pressure, 1e-9) / PSF * {scale})")
        remaining = list(range(len(factors)))
        signs = ""

        def take(name: str) -> bool:
            nonlocal signs
            k = next((k for k in remaining if names[k] == name), None)
            if k is not None:
                remaining.remove(k)
                signs += property_of(factors[k])[0]
            return k is not None

        if not take(PRESSURE_AREA):
            take(DYNAMIC_PRESSURE)
            take(AREA)
        divisor = ""
        if axis in _MOMENTS and not take(_MOMENTS[axis][1]):
            divisor = f" / {number(length)}"
        terms = []
        for pair, text in REDUCED:
            if all(any(names[k] == name for k in remaining) for name in pair):
                for name in pair:
                    take(name)
                terms.append(text)
        terms += [self._expressions.value(factors[k], key) for k in remaining]
        product = " * ".join(terms) or "1.0"
        return tidy(operand, f"{'-' if len(signs) % 2 else ''}{product}{divisor}")

    def _resolve(self, name: str, node: Node) -> str:
        """Return the expression of a property. Raise InputError if it is not available."""
        if name in self._functions:
            return self._read(name)
        if name in self._known:
            return f"({number(self._known[name])})"
        if name == PRESSURE_AREA:
            return f"(air.dynamic_pressure / PSF * {number(self._known[AREA])})"
        if name == LIFT_SQUARED:
            return self._lift_squared(node)
        if name in UNKNOWN_RATES:
            self.notes.append(f"{name}, which is set to 0")
            return "0.0"
        if name in GROUND:
            self.notes.append("ground effect of terrain above sea level")
        if name in PROPERTIES:
            return PROPERTIES[name]
        if name in NORMS:
            angle, text = NORMS[name]
            return f"({text} / {number(self._full.get(angle, self._full['']))})"
        key = free_name(name.replace("-", "_").rpartition("/")[2], self._taken)
        if name not in self.settings:
            self._taken.add(key)
            self.settings[name] = Setting(key, self._values.get(name, 0.0))
        setting = self.settings[name]
        if self._pending and self._pending[-1] not in setting.used_by:
            setting.used_by.append(self._pending[-1])
        return f"settings.{setting.key}"

    def _lift_squared(self, node: Node) -> str:
        if self.frame == "body":
            raise node.refuse("the model has no lift coefficient to be squared", "the axis LIFT")
        if LIFT_SQUARED not in self._done:
            for name, (_, axis) in self._functions.items():
                if axis == "LIFT":
                    self._read(name)
            total = " + ".join(self._terms.get("LIFT", ())) or "0.0"
            self.body.append(Line(f"cl_squared = ({total}) ** 2", "of the whole lift"))
            self._done[LIFT_SQUARED] = "cl_squared"
        return self._done[LIFT_SQUARED]

    def _sums(self, axes: dict[str, Node]) -> Iterable[str]:
        for name in axes:
            sign, coefficient = self._coefficients.get(name) or ("", _MOMENTS[name][0])
            if terms := self._terms[name]:
                total = " + ".join(terms)
                yield f"{coefficient}={f'-({total})' if sign else total}"
