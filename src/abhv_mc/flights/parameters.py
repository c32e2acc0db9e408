"""Parameters of flights: quantities that a campaign can disperse."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import Refusal
from abhv_mc.io.units import (
    TEMPERATURE_DIFFERENCE,
    dimension_of,
    parse_in_any_unit,
    parse_plausible,
    parse_quantity,
)

ONE = "one"  # constant factor on terms without a parameter


@dataclass(frozen=True)
class Parameter:
    """Quantity that a campaign can disperse."""

    name: str
    unit: str  # SI unit, or the unit used by a custom simulator; "-" for a factor (1.0 = nominal)
    nominal: float
    doc: str
    of_user: bool = (
        False  # whether the user defines the parameter (simulator input or vehicle setting)
    )
    seed: bool = False  # whether the parameter selects a realization of noise or turbulence
    noises: tuple[str, ...] = ()  # noise parameters to which a seed from 0 to 1 applies
    is_category: bool = False  # whether the values are names, which have no order

    @property
    def is_factor(self) -> bool:
        """True if the parameter is a factor (1 = nominal) rather than an increment."""
        return self.nominal == 1.0 and (self.unit == "-" or not self.of_user)

    @property
    def unit_suffix(self) -> str:
        """Unit after a number in a campaign file; '' if a plain number has the parameter's unit."""
        return "" if self.of_user or self.unit == "-" else f" {self.unit}"

    def read(
        self, value: float | str, of_nominal: bool = False, bare_unit: str | None = None
    ) -> float:
        """Convert a quantity to the parameter's unit. Raise Refusal if the conversion fails.

        If `of_nominal`, a percentage is relative to the nominal value. Temperatures of the built-in
        simulator are differences. ``bare_unit`` is the unit of its plain numbers.
        """
        if not self.of_user and self.unit == "K":
            return parse_plausible(value, TEMPERATURE_DIFFERENCE, bare_unit)
        if not self.of_user:
            return parse_quantity(value, dimension_of(self.unit), bare_unit)
        if (
            of_nominal
            and self.unit != "%"
            and isinstance(value, str)
            and value.rstrip().endswith("%")
        ):
            if self.nominal == 0.0:
                raise Refusal(
                    f"'{value}' is relative to the nominal value 0", f"a quantity in {self.unit}"
                )
            return parse_in_any_unit(value, "-") * abs(self.nominal)
        return parse_in_any_unit(value, self.unit)


@dataclass(frozen=True)
class Parameters:
    """Parameters of flights, in the order of the columns of parameter arrays."""

    records: tuple[Parameter, ...] = field(repr=False)

    @cached_property
    def index(self) -> Mapping[str, int]:
        return {record.name: i for i, record in enumerate(self.records)}

    @cached_property
    def nominal(self) -> Floats:
        """Nominal values [parameter]."""
        return np.array([record.nominal for record in self.records])

    @cached_property
    def dispersible(self) -> tuple[str, ...]:
        """Names of all parameters except the constant factor ``one``."""
        return tuple(name for name in self.index if name != ONE)

    def __getitem__(self, name: str) -> Parameter:
        return self.records[self.index[name]]

    def __contains__(self, name: object) -> bool:
        return name in self.index

    @cached_property
    def has_program(self) -> bool:
        """True if the parameters of the built-in simulator are included."""
        return ONE in self.index

    def nominal_of(self, names: Iterable[str]) -> Floats:
        """Return the nominal values [name] of the named parameters."""
        return self.nominal[[self.index[name] for name in names]]
