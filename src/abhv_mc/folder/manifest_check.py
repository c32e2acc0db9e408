"""Whether a manifest is one that a campaign may have written: its entries are printed, compared and counted with."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from abhv_mc.folder.layout import is_inside
from abhv_mc.io.input_error import is_printable


def _check_printable(text: str) -> str:
    if not is_printable(text):
        raise ValueError("not printable")
    return text


def _check_inside(name: str) -> str:
    if not is_inside(name):
        raise ValueError("no path in the folder")
    return name


Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]
Text = Annotated[str, Field(max_length=2000), AfterValidator(_check_printable)]
Place = Annotated[str, AfterValidator(_check_inside)]
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]*$")]
Count = Annotated[int, Field(ge=0, le=10**12)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Part = Annotated[int, Field(ge=1)]


class Entries(BaseModel):
    """Entries that somebody reads: others may be there, and those with a default may be missing."""

    model_config = ConfigDict(extra="allow", strict=True)


class _Controller(Entries):
    flights_done: Count
    outcomes: dict[Text, Count]
    failed_to_run: list[Count] = []


class _Requirement(Entries):
    metric: Text
    below: Number = 0.0
    above: Number = 0.0
    probability: Number
    controller: Text
    flights: Count
    failures: Count
    verdict: Text
    words: Text = ""


class _Machine(Entries):
    device: Text = ""


class _Worst(Entries):
    kind: Literal["worst"]
    controller: Name
    metric: Text
    largest: bool
    box: Number
    flights: Count


class _Rare(Entries):
    kind: Literal["rare"]
    controller: Name
    requirement: Text
    target_cov: Number
    flights: Count


class _Result(Entries):
    """Of a search: what of it is held against its flights."""

    flights: Part
    flight: Count = 0
    random_flight: Count = 0
    value: float = 0.0
    random_worst: float = 0.0
    failures: Count = 0
    ended_early: Count
    ended_early_fails: bool = False
    below: Number = 0.0
    above: Number = 0.0


class _Manifest(Entries):
    name: Name | Literal[""] = ""
    state: Literal["running", "complete", "interrupted"] = "running"
    runs_planned: Count = 0
    runs_done: Count = 0
    runs_failed: Count = 0
    seed: Annotated[int, Field(ge=0)] = 0
    campaign_hash: Hash = ""
    source_hash: Text = ""
    started: Text = ""
    wall_time_s: Number = 0.0
    digest: Hash | None = None
    digests: dict[Text, Hash] = {}
    healed: Hash = ""
    controllers: dict[Text, _Controller] = {}
    requirements: list[_Requirement] = []
    versions: dict[Text, Any] = {}
    machine: _Machine = _Machine()
    inputs: dict[Place, Hash] = {}
    files: dict[Place, Hash] = {}
    warnings: list[Text] = []
    shard: Annotated[list[Part], Field(min_length=2, max_length=2)] | None = None


class _SearchManifest(_Manifest):
    search: _Worst | _Rare = Field(discriminator="kind")
    result: _Result | None = None


def find_fault(manifest: dict[str, Any]) -> str | None:
    """The first entry that is of another type, or out of range, in words; None where there is none."""
    return first_fault(_SearchManifest if "search" in manifest else _Manifest, manifest)


def first_fault(model: type[BaseModel], data: Any) -> str | None:
    """The first entry that does not fit the model, in words; None where all do."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return None
