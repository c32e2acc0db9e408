"""What the integrator's default step costs: the metrics of dispersed flights at 10 ms against 5 ms."""

from pathlib import Path

import numpy as np

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.flight.prepare import make_plan
from abhv_mc.flight.signals import METRICS
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.vehicle.arrays import Floats
from abhv_mc.verification.rows import Row

# Zhu & Shen (2014), section 7: uniform, half widths.
_DISPERSIONS = {"atmosphere.density": 0.10, "aero.lift": 0.10, "aero.drag": 0.15}
_SHARE = 0.01  # of a metric's spread


def draw_parameters(flights: int, seed: int = 2014) -> Floats:
    """The paper's dispersions, ``[flight, parameter]``."""
    generator = np.random.default_rng(seed)
    parameters = nominal_parameters(flights)
    for name, half_width in _DISPERSIONS.items():
        parameters[:, PARAMETER_INDEX[name]] += generator.uniform(-half_width, half_width, flights)
    return parameters


def fly_at(step: float, parameters: Floats, controller: Path) -> FlightBlock:
    """The S manoeuvre with an integrator step (s)."""
    configs = shipped_configs()
    mission = read_mission(configs / "mission" / "s_manoeuvre.yaml").model_copy(update={"step": step})
    vehicle = load_vehicle(configs / "vehicle" / "ghame_x.yaml")
    return fly(make_plan(vehicle, mission, read_controller(controller), controller.stem), parameters)


def verify_step(flights: int = 304, controller: str = "tlc", scale: float = 1.0) -> list[Row]:
    """Rows of every metric: largest change over the flights when the default step is halved, over its spread.

    ``scale`` multiplies the tolerance.
    """
    control = shipped_configs() / "control"
    path = control / f"{controller}.yaml"
    if not path.is_file():
        known = sorted(file.stem for file in control.glob("*.yaml"))
        raise InputError("--controller", None, None, f"'{controller}'", one_of(known, controller))
    default = read_mission(shipped_configs() / "mission" / "s_manoeuvre.yaml").step
    parameters = draw_parameters(flights)
    coarse, fine = (fly_at(step, parameters, path) for step in (default, 0.5 * default))
    flown = f"{controller}, {flights} flights"
    rows = [
        Row(
            "half the step",
            flown,
            "outcomes that change",
            "-",
            float((coarse.outcome != fine.outcome).sum()),
            0.0,
        )
    ]
    for i, metric in enumerate(METRICS):
        spread = float(np.std(fine.metrics[:, i]))
        change = float(np.abs(coarse.metrics[:, i] - fine.metrics[:, i]).max())
        share = change / spread if spread > 0.0 else change
        rows.append(
            Row(
                "half the step", f"{controller}, {flights} flights", metric.name, "of its spread", share, scale * _SHARE
            )
        )
    return rows
