"""Simulation of a table of inputs in memory, without a results folder."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import make_ready, open_executor, simulate
from abhv_mc.flights.blocks import Recording
from abhv_mc.folder.flights import END_TIME
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError, one_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def simulate_table(
    experiment: Experiment,
    inputs: "pd.DataFrame",
    controllers: Sequence[str] | None = None,
    channels: Sequence[str] = (),
    engine: Engine | None = None,
) -> "xr.Dataset":
    """Simulate each row of a table with each controller; see :func:`abhv_mc.simulate`.

    Raise InputError if xarray is not installed or an argument is invalid.
    """
    try:
        import xarray as xr
    except ImportError:
        raise InputError("simulate", "xarray is not installed", "pip install xarray") from None
    names = tuple(map(str, inputs.columns))
    experiment = replace(experiment, engine=engine)
    simulator = experiment.simulator
    channel_index = {
        channel.name: i
        for i, channel in enumerate(experiment.channels)
        if simulator.mission  # All flights then have the same sample times.
    }
    systems = experiment.controllers if controllers is None else tuple(controllers)
    for kind, requested, choices in (
        ("inputs", names, experiment.parameters.dispersible),
        ("controllers", systems, experiment.controllers),
        ("channels", channels, tuple(channel_index)),
    ):
        for name in requested:
            if name not in choices or list(requested).count(name) > 1:
                raise InputError(
                    kind,
                    f"'{name}' appears twice" if name in choices else f"unknown name '{name}'",
                    one_of(choices, name),
                )
    try:
        rows = inputs.to_numpy(np.float64)
    except (TypeError, ValueError):
        raise InputError(
            "inputs",
            "the table has entries that are not numbers",
            "numbers in SI units, or in the units of the inputs",
        ) from None
    if np.isnan(rows).any() or not (rows.size or len(rows)) or not systems:
        raise InputError(
            "inputs",
            "the table is empty or has empty cells",
            "a number for each flight and input",
        )
    plans = simulator.fit_plans(simulator.make_plans(systems), names, rows)
    recording = None
    if channels:
        every = simulator.find_stride(next(iter(plans.values())), "histories")
        recording = Recording(every, tuple(channel_index[name] for name in channels))
    ready = replace(make_ready(experiment, plans), columns=names)
    with open_executor(simulator.engine, experiment.model.execution, None) as executor:
        blocks = [simulate(ready, name, rows, recording, executor.fly_parallel) for name in systems]
    axes = ("controller", "flight")
    columns = [np.column_stack([block.metrics, block.end_time]).T for block in blocks]
    variables: dict[str, Any] = {
        signal.name: (axes, np.stack([values[i] for values in columns]), {"units": signal.unit})
        for i, signal in enumerate((*experiment.measured, END_TIME))
    }
    for i, name in enumerate(channels):
        history = np.stack([block.history[:, :, i] for block in blocks])
        units = {"units": experiment.channels[channel_index[name]].unit}
        variables[name] = (*axes, "time"), history, units
    outcomes = [experiment.outcomes.of(block.outcome) for block in blocks]
    coordinates = {"controller": list(systems), "flight": inputs.index.to_numpy()}
    if channels:
        coordinates["time"] = blocks[0].times
    dataset = xr.Dataset({"outcome": (axes, np.array(outcomes, object)), **variables}, coordinates)
    return dataset.assign_attrs(campaign=experiment.name)
