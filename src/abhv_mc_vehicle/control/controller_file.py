"""Pydantic model of controller files, with the gains and limits of TLC and LQR.

The defaults are those of Zhu and Shen 2014.
"""

from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import ConfigDict, Discriminator, Field, RootModel, Tag, model_validator

from abhv_mc.io.documents import Document, StrictModel, read_document, validate
from abhv_mc.io.messages import Refusal, found_value, one_of
from abhv_mc.io.units import Angle, AngularRate, Frequency, Pressure, Time
from abhv_mc_vehicle.control.law_file import (
    CController,
    ControllerModel,
    FmuController,
    ProcessController,
    PythonController,
    UserController,
)
from abhv_mc_vehicle.vehicle.shared_keys import AngleRange, Positive

Weight = Annotated[float, Field(ge=0.0)]
InputWeight = Annotated[float, Positive]
States = TypeVar("States", bound=StrictModel)
Inputs = TypeVar("Inputs", bound=StrictModel)


class TimePoint(StrictModel):
    """Bandwidth at a flight time."""

    time: Annotated[Time, Field(ge=0.0)]
    """time of the point since the start of the flight"""
    bandwidth: Annotated[AngularRate, Positive]
    """natural frequency of the closed loop at the time of this point"""


class PressurePoint(StrictModel):
    """Bandwidth at a dynamic pressure of the reference trajectory."""

    dynamic_pressure: Annotated[Pressure, Positive]
    """dynamic pressure on the reference trajectory"""
    bandwidth: Annotated[AngularRate, Positive]
    """natural frequency of the closed loop at the dynamic pressure of this point"""


class Schedule(StrictModel):
    """Scheduled bandwidth, linear between the points and constant outside them."""

    over_time: list[TimePoint] | None = Field(None, min_length=2)
    """points in order of increasing time"""
    over_dynamic_pressure: list[PressurePoint] | None = Field(None, min_length=2)
    """points in order of increasing dynamic pressure; replaces the key 'over_time'"""

    @model_validator(mode="after")
    def _check(self) -> "Schedule":
        if (self.over_time is None) == (self.over_dynamic_pressure is None):
            raise Refusal(
                "both or neither of over_time and over_dynamic_pressure are set",
                "exactly one of them",
            )
        key = "over_time" if self.over_time is not None else "over_dynamic_pressure"
        for i, (left, right) in enumerate(zip(self.points()[:-1], self.points()[1:], strict=True)):
            if right[0] <= left[0]:
                raise Refusal(
                    f"{right[0]:g} follows {left[0]:g}", "increasing values", (key, i + 1)
                )
        return self

    def points(self) -> list[tuple[float, float]]:
        """Return pairs of (time or dynamic pressure, bandwidth), in SI units."""
        if self.over_time is not None:
            return [(point.time, point.bandwidth) for point in self.over_time]
        return [
            (point.dynamic_pressure, point.bandwidth) for point in self.over_dynamic_pressure or []
        ]


def _bandwidth_kind(value: Any) -> str:
    return "schedule" if isinstance(value, (dict, Schedule)) else "number"


class Channel(StrictModel):
    """Second-order PD spectrum of one channel, equation (20) of Zhu and Shen 2014."""

    damping: Annotated[float, Positive]
    """damping ratio zeta of the closed loop"""
    bandwidth: Annotated[
        Annotated[AngularRate, Positive, Tag("number")] | Annotated[Schedule, Tag("schedule")],
        Discriminator(_bandwidth_kind),
    ]
    """natural frequency of the closed loop, fixed or scheduled"""

    def crossovers(self) -> list[float]:
        """Return the gain crossovers at all points of the schedule, rad/s.

        The open loop (2 zeta omega s + omega^2) / s^2 of a well damped channel crosses over near
        2 zeta omega.
        """
        if isinstance(self.bandwidth, Schedule):
            return [2.0 * self.damping * bandwidth for _, bandwidth in self.bandwidth.points()]
        return [2.0 * self.damping * self.bandwidth]


class VelocityLoop(StrictModel):
    """Closed-loop poles of the velocity loop (sub-loop 2)."""

    flight_path_angle: Channel
    """poles of the flight-path-angle error dynamics"""
    heading: Channel
    """poles of the heading error dynamics"""
    speed: Channel
    """poles of the speed error dynamics"""


class AttitudeLoop(StrictModel):
    """Closed-loop poles of the attitude loop (sub-loop 3)."""

    angle_of_attack: Channel
    """poles of the angle-of-attack error dynamics"""
    sideslip: Channel
    """poles of the sideslip error dynamics"""
    bank: Channel
    """poles of the bank error dynamics"""


class RateLoop(StrictModel):
    """Closed-loop poles of the body-rate loop (sub-loop 4); axes forward, right and down."""

    roll_rate: Channel
    """poles of the roll-rate error dynamics"""
    pitch_rate: Channel
    """poles of the pitch-rate error dynamics"""
    yaw_rate: Channel
    """poles of the yaw-rate error dynamics"""


class Differentiators(StrictModel):
    """Bandwidths of the pseudo-differentiators, equation (21) of Zhu and Shen 2014."""

    attitude: Annotated[AngularRate, Positive] = 0.3
    """bandwidth for differentiating the commands to sub-loop 3"""
    rates: Annotated[AngularRate, Positive] = 1.5
    """bandwidth for differentiating the commands to sub-loop 4"""


class CommandLimits(StrictModel):
    """Limits of the guidance commands; limits of surfaces and engine are in the vehicle file."""

    angle_of_attack: AngleRange = (-0.017453292519943295, 0.20943951023931956)
    """minimum and maximum commanded angle of attack"""
    bank: Annotated[Angle, Field(gt=0.0, lt=1.5)] = 1.2217304763960306
    """maximum commanded bank angle in either direction"""


_OUTER_AND_INNER = (
    ("altitude", "velocity.flight_path_angle"),
    ("velocity.flight_path_angle", "attitude.angle_of_attack"),
    ("velocity.heading", "attitude.bank"),
    ("attitude.angle_of_attack", "rates.pitch_rate"),
    ("attitude.sideslip", "rates.yaw_rate"),
    ("attitude.bank", "rates.roll_rate"),
)


class TlcController(ControllerModel):
    """Trajectory linearization controller (TLC)."""

    law: Literal["tlc"]
    """kind of control law"""
    rate: Annotated[Frequency, Positive] = 100.0
    """control ticks per second"""
    altitude: Channel
    """sub-loop 1: poles of the altitude error dynamics"""
    velocity: VelocityLoop
    """sub-loop 2: flight path angle, heading, speed"""
    attitude: AttitudeLoop
    """sub-loop 3: angle of attack, sideslip, bank"""
    rates: RateLoop
    """sub-loop 4: roll, pitch and yaw rate"""
    differentiators: Differentiators = Differentiators()
    """bandwidths of the pseudo-differentiators"""
    limits: CommandLimits = CommandLimits()
    """limits on the guidance commands"""

    def warnings(self) -> list[str]:
        """Return a warning for each outer loop that is not slower than its inner loop."""
        warnings = []
        for outer, inner in _OUTER_AND_INNER:
            fastest = max(attrgetter(outer)(self).crossovers())
            slowest = min(attrgetter(inner)(self).crossovers())
            if fastest >= slowest:
                warnings.append(
                    f"the crossover of {outer} ({fastest:g} rad/s) is not below that of "
                    f"{inner} ({slowest:g} rad/s): the time scales of the loops are not "
                    "separated"
                )
        return warnings


class Weights(StrictModel, Generic[States, Inputs]):
    """Weights of a linear quadratic regulator."""

    states: States
    """diagonal of the matrix Q, one weight for each deviation"""
    inputs: Inputs
    """diagonal of the matrix R, one weight for each input"""


class GuidanceStates(StrictModel):
    """Weights of the deviations of the guidance states, in SI units and radians."""

    altitude: Weight
    """weight of the squared deviation of the altitude, 1/m2"""
    flight_path_angle: Weight
    """weight of the squared deviation of the flight path angle, 1/rad2"""
    heading: Weight
    """weight of the squared deviation of the heading, 1/rad2"""
    speed: Weight
    """weight of the squared deviation of the speed, s2/m2"""


class GuidanceInputs(StrictModel):
    """Weights of the guidance inputs, which are in radians."""

    angle_of_attack: InputWeight
    """weight of the squared angle of attack, 1/rad2"""
    bank: InputWeight
    """weight of the squared bank angle, 1/rad2"""
    equivalence_ratio: InputWeight
    """weight of the squared equivalence ratio"""


class LongitudinalStates(StrictModel):
    """Weights of the deviations of the longitudinal states, which are in radians."""

    angle_of_attack: Weight
    """weight of the squared deviation of the angle of attack, 1/rad2"""
    pitch_rate: Weight
    """weight of the squared deviation of the pitch rate, s2/rad2"""


class LongitudinalInputs(StrictModel):
    """Weight of the longitudinal input, which is in degrees."""

    elevator: InputWeight
    """weight of the squared elevator deflection, 1/deg2"""


class LateralStates(StrictModel):
    """Weights of the deviations of the lateral states, which are in radians."""

    bank: Weight
    """weight of the squared deviation of the bank angle, 1/rad2"""
    sideslip: Weight
    """weight of the squared deviation of the sideslip, 1/rad2"""
    roll_rate: Weight
    """weight of the squared deviation of the roll rate, s2/rad2"""
    yaw_rate: Weight
    """weight of the squared deviation of the yaw rate, s2/rad2"""


class LateralInputs(StrictModel):
    """Weights of the lateral inputs, which are in degrees."""

    aileron: InputWeight
    """weight of the squared aileron deflection, 1/deg2"""
    rudder: InputWeight
    """weight of the squared rudder deflection, 1/deg2"""


class LqrController(ControllerModel):
    """Linear quadratic regulator with gains scheduled along the reference."""

    law: Literal["lqr"]
    """kind of control law"""
    rate: Annotated[Frequency, Positive] = 100.0
    """control ticks per second"""
    guidance: Weights[GuidanceStates, GuidanceInputs]
    """weights of the guidance regulator, equation (22) of Zhu and Shen (2014)"""
    longitudinal: Weights[LongitudinalStates, LongitudinalInputs]
    """weights of the pitch regulator, equation (23) of Zhu and Shen (2014)"""
    lateral: Weights[LateralStates, LateralInputs]
    """weights of the roll and yaw regulator, equation (23) of Zhu and Shen (2014)"""
    spacing: Annotated[Time, Field(gt=0.0)] = 1.0
    """time between the reference points at which gains are computed"""
    limits: CommandLimits = CommandLimits()
    """limits on the guidance commands"""


Controller = TlcController | LqrController | UserController


CONTROLLERS: dict[str, type[Controller]] = {
    "tlc": TlcController,
    "lqr": LqrController,
    "python": PythonController,
    "c": CController,
    "fmu": FmuController,
    "process": ProcessController,
}


class ControllerFile(RootModel[Any]):
    """Content of a controller file of any kind."""

    model_config = ConfigDict(defer_build=True)
    root: Annotated[Controller, Field(discriminator="law")]


def read_controller_document(path: str | Path | Document) -> tuple[Document, Controller]:
    """Read and check a controller file without running custom control laws.

    Raise InputError if the file is invalid.
    """
    document = read_document(path)
    law = document.data.get("law") if isinstance(document.data, dict) else None
    if not isinstance(law, str) or law not in CONTROLLERS:
        raise document.error(("law",), found_value(law), one_of(CONTROLLERS, law))
    return document, validate(document, CONTROLLERS[law])


def read_controller(path: str | Path) -> Controller:
    """Read and check a controller file. Raise InputError if it is invalid."""
    return read_controller_document(path)[1]
