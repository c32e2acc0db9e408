"""What the flights of one system of a user's simulator need, and whether this user may run it."""

import hashlib
import json
import os
import stat
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.simulator import Simulator, SimulatorCampaign
from abhv_mc.flight.channels import Signal
from abhv_mc.flight.metrics import Metric
from abhv_mc.flight.outcome import Outcome
from abhv_mc.io.input_error import InputError, is_exhausted
from abhv_mc.io.input_files import read_input
from abhv_mc.user_code.source import UserSource

_PYTHON = (sys.executable, "-P", str(Path(__file__).with_name("python_lines.py")))


@dataclass(frozen=True)
class UserPlan:
    """Everything that is needed to fly one system, apart from its flights' inputs; it travels to other machines."""

    controller: str  # its name in the campaign
    command: tuple[str, ...]
    folder: str  # that it lies and runs in
    files: tuple[tuple[str, str], ...]  # place in the folder and SHA-256 of what it consists of
    python: str  # the file of a Python function, '' for a program
    settings: str  # JSON
    inputs: tuple[str, ...]
    seeds: tuple[bool, ...]  # which of these are whole numbers
    metrics: tuple[Metric, ...]
    outcomes: dict[str, int]  # codes that a flight may return, with their numbers
    time_limit: float  # s of one flight, by the clock
    channels: tuple[Signal, ...] = ()  # of the history that a flight returns
    rate: float = 10.0  # Hz that it is recorded with, and for bands over time
    band_rate: float = 5.0
    effectors: tuple[str, ...] = ()
    campaign_folder: str = ""  # that the campaign file lies in
    check: int = 0  # number of the process that simulates it for a check; 0: for the campaign

    @property
    def process(self) -> tuple[object, ...]:
        """What a process that flies it is known by: it may fly the other systems, too."""
        return self.command, self.folder, self.files, self.python, self.check

    @property
    def system(self) -> tuple[object, ...]:
        """What is simulated, in whatever process."""
        return self.command, self.folder, self.files, self.python, self.controller

    @property
    def argv(self) -> list[str]:
        """What starts the process."""
        if self.python:
            names = (name for name, _ in self.files)
            return [*_PYTHON, self.python, self.folder, self.campaign_folder, *names]
        first, *rest = self.command
        file = Path(self.folder, first)
        return [str(file.resolve()) if file.is_file() else first, *rest]

    @cached_property
    def expected(self) -> set[str]:
        """What a flight has to return."""
        return {*(metric.name for metric in self.metrics), *(["history"] if self.channels else [])}

    @cached_property
    def _template(self) -> str:
        parts = (
            f"{json.dumps(name)}: %{'d' if seed else 'r'}"
            for name, seed in zip(self.inputs, self.seeds, strict=True)
        )
        return f'{{"inputs": {{{", ".join(parts)}}}, "settings": {self.settings.replace("%", "%%")}}}\n'

    def lines(self, rows: Floats) -> list[bytes]:
        """A line of JSON for each of ``rows`` [flight, input]."""
        return [(self._template % tuple(row)).encode() for row in rows.tolist()]

    def check_files(self) -> None:
        """Raise InputError where its files are not, on this machine, those that the campaign was begun with."""
        for name, digest in self.files:
            path = Path(self.folder, name)
            try:
                same = hashlib.sha256(path.read_bytes()).hexdigest() == digest
            except OSError as error:
                if is_exhausted(error):
                    raise
                same = False
            if not same:
                raise InputError(
                    path, "other content than the campaign was begun with, or none", "the same file"
                )
        program = Path(self.argv[0])
        if program.is_file() and not os.access(program, os.X_OK):  # a copy in a campaign's folder
            program.chmod(program.stat().st_mode | stat.S_IXUSR)


def make_user_plans(campaign: Experiment, names: Iterable[str]) -> dict[str, UserPlan]:
    """The plans of some of a campaign's systems. Raises InputError where nothing flies it."""
    model, simulator, base = _find_simulator(campaign)
    files = tuple(
        (name, hashlib.sha256(content).hexdigest())
        for name, content in simulator_source(campaign).files
    )
    codes, records = campaign.outcomes.numbers, campaign.parameters.records
    return {
        name: UserPlan(
            controller=name,
            command=simulator.command or (),
            folder=str(base.resolve()),
            files=files,
            python=simulator.python or "",
            settings=json.dumps(model.systems[name]),
            inputs=tuple(record.name for record in records),
            seeds=tuple(record.seed for record in records),
            metrics=campaign.measured,
            outcomes={
                code: number for code, number in codes.items() if code != Outcome.FAILED_TO_RUN.code
            },
            time_limit=simulator.time_limit,
            channels=campaign.channels,
            rate=model.keep.histories.rate,
            band_rate=model.keep.envelopes.rate,
            campaign_folder=str(campaign.document.path.parent.resolve()),
        )
        for name in names
    }


def _find_simulator(campaign: Experiment) -> tuple[SimulatorCampaign, Simulator, Path]:
    """What flies, and the folder that it lies in. Raises InputError where nothing does."""
    model = campaign.user_model
    if model is None or model.simulator is None:
        found = "a campaign without a simulator: nothing can fly"
        raise campaign.document.error(
            (), found, "'simulator' here; abhv-mc adopt TABLE takes flights that were flown"
        )
    return model, model.simulator, campaign.document.path.parent / model.simulator.folder


def simulator_source(campaign: Experiment) -> UserSource:
    """The simulator's files, by which it is trusted. Nothing is run."""
    _, simulator, base = _find_simulator(campaign)
    files = tuple((name, read_input(path)) for name, path in simulator.find_files(base).items())
    text = json.dumps([simulator.python, simulator.command])
    return UserSource(
        text, str(base / (simulator.python or (simulator.command or ("",))[0])), files
    )
