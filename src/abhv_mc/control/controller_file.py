"""Controller files: the gains and limits of TLC and LQR. The defaults are the paper's (Zhu and Shen 2014)."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, RootModel, Tag, model_validator

from abhv_mc.io.documents import Document, File, Refusal, StrictModel, describe, one_of, read_document, validate
from abhv_mc.io.units import Angle, AngularRate, Frequency, Pressure, Time

Positive = Field(gt=0.0)


class TimePoint(StrictModel):
    """Bandwidth at a time."""

    time: Annotated[Time, Field(ge=0.0)]
    bandwidth: Annotated[AngularRate, Positive]


class PressurePoint(StrictModel):
    """Bandwidth at a dynamic pressure of the reference."""

    dynamic_pressure: Annotated[Pressure, Positive]
    bandwidth: Annotated[AngularRate, Positive]


class Schedule(StrictModel):
    """A bandwidth that changes: linear between points, held outside."""

    over_time: list[TimePoint] | None = Field(None, min_length=2)
    over_dynamic_pressure: list[PressurePoint] | None = Field(None, min_length=2)

    @model_validator(mode="after")
    def _check(self) -> "Schedule":
        if (self.over_time is None) == (self.over_dynamic_pressure is None):
            raise Refusal("both or none of the two", "over_time or over_dynamic_pressure")
        key = "over_time" if self.over_time is not None else "over_dynamic_pressure"
        for i, (left, right) in enumerate(zip(self.points()[:-1], self.points()[1:], strict=True)):
            if right[0] <= left[0]:
                raise Refusal(f"{right[0]:g} after {left[0]:g}", "points that rise", (key, i + 1))
        return self

    def points(self) -> list[tuple[float, float]]:
        """(time or dynamic pressure, bandwidth), SI."""
        if self.over_time is not None:
            return [(point.time, point.bandwidth) for point in self.over_time]
        return [(point.dynamic_pressure, point.bandwidth) for point in self.over_dynamic_pressure or []]


def _bandwidth_kind(value: Any) -> str:
    return "schedule" if isinstance(value, (dict, Schedule)) else "number"


class Channel(StrictModel):
    """Second-order PD spectrum of one channel, equation (20)."""

    damping: Annotated[float, Positive]
    bandwidth: Annotated[
        Annotated[AngularRate, Positive, Tag("number")] | Annotated[Schedule, Tag("schedule")],
        Discriminator(_bandwidth_kind),
    ]

    def largest(self) -> float:
        """The greatest bandwidth that the channel ever has, rad/s."""
        if isinstance(self.bandwidth, Schedule):
            return max(bandwidth for _, bandwidth in self.bandwidth.points())
        return self.bandwidth

    def least(self) -> float:
        """The smallest bandwidth that the channel ever has, rad/s."""
        if isinstance(self.bandwidth, Schedule):
            return min(bandwidth for _, bandwidth in self.bandwidth.points())
        return self.bandwidth


class VelocityLoop(StrictModel):
    """Sub-loop 2."""

    flight_path_angle: Channel
    heading: Channel
    speed: Channel


class AttitudeLoop(StrictModel):
    """Sub-loop 3."""

    angle_of_attack: Channel
    sideslip: Channel
    bank: Channel


class RateLoop(StrictModel):
    """Sub-loop 4, body axes forward, right, down."""

    roll_rate: Channel
    pitch_rate: Channel
    yaw_rate: Channel


class Differentiators(StrictModel):
    """Bandwidths of the pseudo-differentiators (21)."""

    attitude: Annotated[AngularRate, Positive] = Field(0.3, description="of the commands to sub-loop 3")
    rates: Annotated[AngularRate, Positive] = Field(1.5, description="of the commands to sub-loop 4")


class CommandLimits(StrictModel):
    """Limits of the guidance's commands; those of the surfaces and the engine are the vehicle's."""

    angle_of_attack: tuple[Angle, Angle] = Field((-0.017453292519943295, 0.20943951023931956))
    bank: Annotated[Angle, Field(gt=0.0, lt=1.5)] = Field(1.2217304763960306, description="to either side")

    @model_validator(mode="after")
    def _check(self) -> "CommandLimits":
        if self.angle_of_attack[0] >= self.angle_of_attack[1]:
            raise Refusal("an empty range", "the lower angle before the higher one", ("angle_of_attack",))
        return self


class TlcController(StrictModel):
    """Trajectory linearization control."""

    law: Literal["tlc"]
    rate: Annotated[Frequency, Positive] = 100.0
    altitude: Channel
    velocity: VelocityLoop
    attitude: AttitudeLoop
    rates: RateLoop
    differentiators: Differentiators = Differentiators()
    limits: CommandLimits = CommandLimits()

    def warnings(self) -> list[str]:
        """Sentences on outer loops that are not slower than the inner loop that they rely on."""
        pairs = [
            ("altitude", self.altitude, "velocity.flight_path_angle", self.velocity.flight_path_angle),
            (
                "velocity.flight_path_angle",
                self.velocity.flight_path_angle,
                "attitude.angle_of_attack",
                self.attitude.angle_of_attack,
            ),
            ("velocity.heading", self.velocity.heading, "attitude.bank", self.attitude.bank),
            ("attitude.angle_of_attack", self.attitude.angle_of_attack, "rates.pitch_rate", self.rates.pitch_rate),
            ("attitude.sideslip", self.attitude.sideslip, "rates.yaw_rate", self.rates.yaw_rate),
            ("attitude.bank", self.attitude.bank, "rates.roll_rate", self.rates.roll_rate),
        ]
        return [
            f"the bandwidth of {outer} ({slow.largest():g} rad/s) is not below that of {inner} ({fast.least():g} "
            "rad/s): the loops' time scales are not separated"
            for outer, slow, inner, fast in pairs
            if slow.largest() >= fast.least()
        ]


class GuidanceStates(StrictModel):
    """Weights of the deviations, SI and radians."""

    altitude: Annotated[float, Field(ge=0.0)]
    flight_path_angle: Annotated[float, Field(ge=0.0)]
    heading: Annotated[float, Field(ge=0.0)]
    speed: Annotated[float, Field(ge=0.0)]


class GuidanceInputs(StrictModel):
    """Weights of the inputs, radians."""

    angle_of_attack: Annotated[float, Positive]
    bank: Annotated[float, Positive]
    equivalence_ratio: Annotated[float, Positive]


class GuidanceWeights(StrictModel):
    """Weights of the guidance regulator (22)."""

    states: GuidanceStates
    inputs: GuidanceInputs


class LongitudinalStates(StrictModel):
    """Weights of the deviations, radians."""

    angle_of_attack: Annotated[float, Field(ge=0.0)]
    pitch_rate: Annotated[float, Field(ge=0.0)]


class LongitudinalInputs(StrictModel):
    """Weight of the input in degrees."""

    elevator: Annotated[float, Positive]


class LongitudinalWeights(StrictModel):
    """Weights of the pitch regulator (23)."""

    states: LongitudinalStates
    inputs: LongitudinalInputs


class LateralStates(StrictModel):
    """Weights of the deviations, radians."""

    bank: Annotated[float, Field(ge=0.0)]
    sideslip: Annotated[float, Field(ge=0.0)]
    roll_rate: Annotated[float, Field(ge=0.0)]
    yaw_rate: Annotated[float, Field(ge=0.0)]


class LateralInputs(StrictModel):
    """Weights of the inputs in degrees."""

    aileron: Annotated[float, Positive]
    rudder: Annotated[float, Positive]


class LateralWeights(StrictModel):
    """Weights of the roll and yaw regulator (23)."""

    states: LateralStates
    inputs: LateralInputs


class LqrController(StrictModel):
    """Linear quadratic regulator along the reference."""

    law: Literal["lqr"]
    rate: Annotated[Frequency, Positive] = 100.0
    guidance: GuidanceWeights
    longitudinal: LongitudinalWeights
    lateral: LateralWeights
    spacing: Annotated[Time, Field(gt=0.0)] = Field(1.0, description="between the points where gains are computed")
    limits: CommandLimits = CommandLimits()

    def warnings(self) -> list[str]:
        """Nothing that a file alone shows."""
        return []


class PythonController(StrictModel):
    """A law of one's own, in a Python file."""

    law: Literal["python"]
    file: File = Field(description="the law, see abhv_mc.extend")
    rate: Annotated[Frequency, Positive] = 100.0
    settings: dict[str, Any] = Field({}, description="of the file's class Settings; with units where the file says so")

    def warnings(self) -> list[str]:
        """Nothing that a file alone shows."""
        return []


Controller = TlcController | LqrController | PythonController


class ControllerFile(RootModel[Annotated[Controller, Field(discriminator="law")]]):
    """Any controller file."""


def read_controller_document(path: str | Path) -> tuple[Document, Controller]:
    """Read and check a controller file; a law of one's own is not run. Raises InputError."""
    document = read_document(path)
    law = document.data.get("law") if isinstance(document.data, dict) else None
    models: dict[Any, type[Controller]] = {"tlc": TlcController, "lqr": LqrController, "python": PythonController}
    if law not in models:
        raise document.error(("law",), describe(law), one_of(models, law))
    return document, validate(document, models[law])


def read_controller(path: str | Path) -> Controller:
    """Read and check a controller file. Raises :class:`abhv_mc.io.documents.InputError`."""
    return read_controller_document(path)[1]
