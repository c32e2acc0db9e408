"""A vehicle without thrust loses energy at each tick, whatever it does with its surfaces."""

import numpy as np
import pytest
from short_flights import rows_of

from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan

VEHICLES = shipped_configs() / "vehicle"
# A push-over gains speed by gravity alone.
PUSH_OVER = {
    "base": "level",
    "manoeuvre": {"kind": "pull_up", "flight_path_angle": "-3 deg", "length": "15 s"},
}
MACH_4_7 = ("s_manoeuvre", "climb", "turn", PUSH_OVER)
MISSIONS = {
    "abhv": ("paper_s", *MACH_4_7),
    "ghame": MACH_4_7,
    "ghame_x": MACH_4_7,
    "ghame_x_coupled": MACH_4_7,
    "flexible": ("flexible",),  # the modes' lift does no work
    "winged_cone": ("level_mach15", "turn_mach15"),
    "f16": ("f16_level",),
}
_NO_THRUST = 1.0  # N: a failed engine's thrust dies away with its lag; drag is a hundred times more


def test_every_shipped_vehicle_is_here():
    assert {path.stem for path in VEHICLES.glob("*.yaml")} == set(MISSIONS)


def energy(earth, altitude, latitude, speed):
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
def test_energy_falls_at_each_tick_without_thrust(vehicle, mission, law):
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
