"""A vehicle without thrust loses energy at each tick, whatever it does with its surfaces."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from short_flights import rows_of

from abhv_mc.array_types import Floats
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.kernel.world.earth import Earth
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.table_file import nodes_of
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_coefficients, make_variables

VEHICLES = shipped_configs() / "vehicle"
# A push-over gains speed by gravity alone.
PUSH_OVER = {
    "base": "level",
    "manoeuvre": {"kind": "pull_up", "flight_path_angle": "-3 deg", "length": "15 s"},
}
MACH_4_7: tuple[Any, ...] = ("s_manoeuvre", "climb", "turn", PUSH_OVER)
MISSIONS: dict[str, tuple[Any, ...]] = {
    "abhv": ("paper_s", *MACH_4_7),
    "ghame": MACH_4_7,
    "ghame_x": MACH_4_7,
    "ghame_x_coupled": MACH_4_7,
    "flexible": ("flexible",),  # the modes' lift does no work
    "winged_cone": ("level_mach15", "turn_mach15"),
    "f16": ("f16_level",),
}
_NO_THRUST = 1.0  # N: a failed engine's thrust dies away with its lag; drag is a hundred times more
DEFLECTION, SIDESLIP = np.deg2rad(20.0), np.deg2rad(15.0)


def test_every_shipped_vehicle_is_here() -> None:
    assert {path.stem for path in VEHICLES.glob("*.yaml")} == set(MISSIONS)


def energy(earth: Earth, altitude: Floats, latitude: Floats, speed: Floats) -> Floats:
    """Return V^2 / 2 - W, J/kg: W with J2 and the centrifugal term, at geodetic positions."""
    e2 = earth.flattening * (2.0 - earth.flattening)
    vertical = earth.equatorial_radius / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    rho = (vertical + altitude) * np.cos(latitude)
    z = (vertical * (1.0 - e2) + altitude) * np.sin(latitude)
    radius = np.hypot(rho, z)
    legendre = 1.5 * (z / radius) ** 2 - 0.5
    oblate = 1.0 - earth.j2 * (earth.equatorial_radius / radius) ** 2 * legendre
    potential = earth.gravitational_parameter / radius * oblate
    return 0.5 * speed**2 - potential - 0.5 * (earth.rotation_rate * rho) ** 2


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("vehicle", "mission", "law"),
    [
        (vehicle, mission, law)
        for vehicle, missions in MISSIONS.items()
        for mission in missions
        for law in (("f16_autopilot",) if vehicle == "f16" else ("tlc", "lqr"))
    ],
)
def test_energy_falls_at_each_tick_without_thrust(
    vehicle: str, mission: str | Mapping[str, Any], law: str
) -> None:
    plan = make_flight_plan(mission, vehicle, law)
    block = fly(plan, rows_of({"failure.engine.time": 0.0}), record_every=1)
    ticks = round(block.end_time[0] / plan.timing.tick)
    channels = block.history[0, : ticks + 1].astype(np.float64)
    altitude, latitude, speed, thrust = (
        channels[:, CHANNEL_INDEX[name]]
        for name in ("altitude_m", "latitude_deg", "speed_mps", "thrust_n")
    )
    without = np.maximum(thrust[1:], thrust[:-1]) < _NO_THRUST
    assert np.sum(~without) * plan.timing.tick < 2.0 < ticks * plan.timing.tick
    change = np.diff(energy(plan.earth, altitude, np.deg2rad(latitude), speed))
    assert change[without].max() < 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name in MISSIONS if name != "f16"])
def test_the_air_never_pushes_forward(name: str) -> None:
    """At each node inside the limits: -CD cos(beta) + CY sin(beta) < 0."""
    vehicle = load_vehicle(Path(VEHICLES / f"{name}.yaml"))
    assert vehicle.constants.drag_in_wind_axes == 0.0
    low, high = vehicle.constants.angle_of_attack_min, vehicle.constants.angle_of_attack_max

    def nodes(variable: str, least: float, greatest: float) -> Floats:
        inside = nodes_of(vehicle.tables, variable)
        inside = inside[(inside >= least) & (inside <= greatest)]
        return np.unique([least, *inside, greatest])

    machs = nodes_of(vehicle.tables, "mach")
    angles, sideslips = nodes("angle_of_attack", low, high), np.linspace(0.0, SIDESLIP, 16)
    surfaces = np.linspace(-DEFLECTION, DEFLECTION, 5)
    grid = np.meshgrid(machs, angles, sideslips, surfaces, surfaces, indexing="ij")
    mach, alpha, beta, aileron, rudder = (values.ravel() for values in grid)
    variables = make_variables(
        vehicle,
        mach=mach,
        angle_of_attack=alpha,
        sideslip=beta,
        aileron=aileron,
        rudder=rudder,
        altitude=np.full(mach.size, 20e3),
        mass=np.full(mach.size, vehicle.constants.mass_start),
    )
    _, drag, side, *_ = evaluate_coefficients(vehicle, variables)
    forward = -drag * np.cos(beta) + side * np.sin(beta)
    pushed = forward >= 0.0
    assert not pushed.any(), (
        f"{pushed.sum()} of {pushed.size} nodes, at Mach {np.unique(mach[pushed])}"
    )
